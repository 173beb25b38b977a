"""The notebooks of the documentation: sources without outputs, each runs from the first cell to the last; a kernel that
is interrupted while a study runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

nbformat = pytest.importorskip("nbformat", reason="the extra [docs] is not installed")
pytest.importorskip("nbclient", reason="the extra [docs] is not installed")

from tools import notebooks  # noqa: E402 - needs both
from tools.notebooks import FOLDER, executed  # noqa: E402

PATHS = sorted(FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("path", PATHS, ids=lambda p: p.stem)
def test_a_notebook_in_the_repository_has_no_outputs(path: Path) -> None:
    notebook = nbformat.read(path, 4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        assert "id" not in cell and set(cell.metadata) <= {"tags"}
        if cell.cell_type == "code":
            assert cell.outputs == [] and cell.execution_count is None
    assert notebook.cells[0].source.startswith("# ")


def test_a_notebook_is_run_again_where_anything_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran = list[str]()

    def run(path: Path) -> Any:
        ran.append(path.name)
        return nbformat.read(path, 4)

    monkeypatch.setattr(notebooks, "executed", run)
    monkeypatch.setattr(notebooks, "KEPT", tmp_path / "kept")
    path = tmp_path / "a.ipynb"
    path.write_bytes(PATHS[0].read_bytes())
    first = notebooks.kept(path, b"1")
    assert notebooks.kept(path, b"1") == first and ran == ["a.ipynb"]
    notebooks.kept(path, b"2")
    path.write_text(path.read_text("utf-8").replace("# ", "# Other ", 1), "utf-8")
    notebooks.kept(path, b"2")
    assert len(ran) == 3
    assert len(list((tmp_path / "kept").iterdir())) == 1, "what is of no use any more is gone"


@pytest.mark.parametrize("change", ["sprain_cosim/metrics.py", "sprain_cosim/_fmus/plant.fmu", "scenarios/level.toml"])
def test_what_a_notebook_depends_on(change: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (
        "sprain_cosim/metrics.py",
        "sprain_cosim/_fmus/plant.fmu",
        "scenarios/level.toml",
        "tools/notebooks.py",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    monkeypatch.setattr(notebooks, "ROOT", tmp_path)
    monkeypatch.setattr(notebooks, "__file__", str(tmp_path / "tools" / "notebooks.py"))
    before = notebooks.state()
    assert notebooks.state() == before
    (tmp_path / change).write_text("changed")
    assert notebooks.state() != before


@pytest.mark.long
@pytest.mark.parametrize("path", PATHS, ids=lambda p: p.stem)
def test_a_notebook_runs(path: Path) -> None:
    """Its last cell gives what the text says; a cell that is to fail does, and shows no line of the package."""
    for cell in executed(path).cells:
        failed = [output for output in cell.get("outputs", []) if output.output_type == "error"]
        assert bool(failed) == ("raises-exception" in cell.metadata.get("tags", []))
        for output in failed:
            assert len("\n".join(output.traceback).splitlines()) <= 8
        assert not [o for o in cell.get("outputs", []) if o.output_type == "stream" and o.name == "stderr"]


class Kernel:
    """A kernel as a notebook has one."""

    def __init__(self, folder: Path) -> None:
        from jupyter_client.manager import start_new_kernel

        self.manager, self.client = start_new_kernel(
            kernel_name="python3", cwd=str(folder), extra_arguments=["--Application.log_level=ERROR"]
        )

    def run(self, code: str) -> Iterator[tuple[str, Any]]:
        """(type, content) of what a cell shows, until it has ended."""
        request = self.client.execute(code)
        while True:
            message = self.client.get_iopub_msg(timeout=300)
            if message["parent_header"].get("msg_id") != request:
                continue
            if message["msg_type"] == "status" and message["content"]["execution_state"] == "idle":
                return
            yield message["msg_type"], message["content"]

    def text(self, code: str) -> str:
        return "".join(content["text"] for kind, content in self.run(code) if kind == "stream")

    def children(self) -> int:
        import psutil

        return len(psutil.Process(self.manager.provisioner.pid).children(recursive=True))

    def close(self) -> None:
        self.client.stop_channels()
        self.manager.shutdown_kernel(now=True)


@pytest.fixture
def kernel(tmp_path: Path) -> Iterator[Kernel]:
    opened = Kernel(tmp_path)
    yield opened
    opened.close()


@pytest.mark.long
def test_an_interrupted_cell_leaves_no_worker_and_a_folder_that_goes_on(kernel: Kernel, tmp_path: Path) -> None:
    assert kernel.text("import sprain_cosim as sc; study = sc.load_study('study6')") == ""
    shown, failed, running = list[str](), dict[str, Any](), 0
    for kind, content in kernel.run("study.run(trials=3000, seed=7, workers=2, out='s6')"):
        if kind in ("display_data", "update_display_data"):
            shown.append(content["data"]["text/plain"])
            assert "<progress" in content["data"]["text/html"]
            if len(shown) == 4:
                running = kernel.children()
                kernel.manager.interrupt_kernel()
        if kind == "error":
            failed = content
    assert failed["ename"] == "KeyboardInterrupt"
    assert "the same call with resume=True continues" in "\n".join(failed["traceback"])
    assert kernel.children() <= 1 < 2 <= running  # the server that copies workers stays
    assert 0 < int(shown[-1].split()[0]) < 3000
    again = "study.run(trials=40, seed=7, workers=2, out='s6', resume=True, progress=None).summary.n_completed"
    assert int(kernel.text(f"print({again})")) >= 40
    assert (tmp_path / "s6" / "trials.csv").is_file()
