"""The archive of an FMU: the same files give the same bytes."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path

from ... import files

EPOCH = (1980, 1, 1, 0, 0, 0)


def pack(members: Mapping[str, bytes]) -> bytes:
    """The archive of {path: content}; the same bytes for the same content and zlib."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in sorted(members.items(), key=lambda item: (item[0] != "modelDescription.xml", item[0])):
            entry = zipfile.ZipInfo(path, EPOCH)
            entry.external_attr = 0o644 << 16
            entry.create_system, entry.compress_type = 3, zipfile.ZIP_DEFLATED
            archive.writestr(entry, data, compresslevel=9)
    return buffer.getvalue()


def tree(folder: Path, skip: Collection[str] = ()) -> dict[str, bytes]:
    """{path below `folder`: content}, without compiled Python and what lies below a name in `skip`."""
    left_out = {"__pycache__", *skip}
    found = sorted(
        p for p in folder.rglob("*") if p.is_file() and not left_out.intersection(p.relative_to(folder).parts)
    )
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in found}


def digest(members: Mapping[str, bytes]) -> str:
    """SHA-256 over names and contents."""
    whole = hashlib.sha256()
    for path, data in sorted(members.items()):
        whole.update(f"{path}\0{len(data)}\0".encode() + data)
    return whole.hexdigest()


def write_fmu(target: Path, content: Mapping[str, bytes]) -> None:
    """The FMU at `target`, whole or not at all."""
    files.write(target, pack(content), parents=True)
