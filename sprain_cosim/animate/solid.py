"""Round cones and one box under parallel light and a parallel camera: a small ray caster that needs no OpenGL, no
display and no driver.

Camera frame: x right, y up, z towards the viewer. Intersection of a ray with a round cone after I. Quilez, "Ray-surface
intersectors" (iquilezles.org/articles/intersectors), specialised to rays along -z."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

SAMPLES = 2  # per pixel and direction
LIGHT = np.array([-0.42, 0.78, 0.46])  # towards it, in the camera's frame; the shadow falls along the world's vertical
SHADOWING = 0.35  # m above the box up to which a volume throws a shadow
FAR = -1e9  # depth of a ray that meets nothing
PAPER = np.array([0.965, 0.972, 0.980])


@dataclass(frozen=True)
class Camera:
    """A parallel camera.

    - right, up: (3,) unit vectors in the ground's frame, along the picture's width and height
    - centre: (3,) point [m] in the middle of the picture
    - scale: pixels per metre
    - width, height: of the picture, in pixels
    """

    right: np.ndarray
    up: np.ndarray
    centre: np.ndarray
    scale: float
    width: int
    height: int

    @property
    def turn(self) -> np.ndarray:
        """(3, 3): rows are the camera's axes in the ground's frame."""
        return np.array([self.right, self.up, np.cross(self.right, self.up)])

    def project(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) pixels, y downwards, of (..., 3) points [m] in the ground's frame."""
        p = (points - self.centre) @ self.turn.T
        return np.stack([self.width / 2 + self.scale * p[..., 0], self.height / 2 - self.scale * p[..., 1]], axis=-1)

    def picture(
        self,
        volumes: np.ndarray,
        colours: np.ndarray,
        box: np.ndarray,
        turn: np.ndarray,
        half: np.ndarray,
        box_colour: np.ndarray,
    ) -> np.ndarray:
        """(height, width, 3) uint8: round cones and one box.

        - volumes: (n, 8) round cones, as Skeleton.volumes gives them, in `colours` (n, 3) of 0...1
        - box: (3,) middle of the box [m]; turn: (3, 3) its axes as rows; half: (3,) its half extents [m]
        - box_colour: (3,) of 0...1
        """
        t = self.turn
        cones = np.empty_like(volumes)
        cones[:, :3], cones[:, 3:6], cones[:, 6:] = (
            (volumes[:, :3] - self.centre) @ t.T,
            (volumes[:, 3:6] - self.centre) @ t.T,
            volumes[:, 6:],
        )
        image = np.empty((self.height, self.width, 3), np.uint8)
        light = LIGHT / np.linalg.norm(LIGHT)
        _draw(
            cones,
            colours,
            (box - self.centre) @ t.T,
            turn @ t.T,
            half,
            box_colour,
            SAMPLES * self.scale,
            light,
            t @ [0.0, 1.0, 0.0],
            PAPER,
            image,
        )
        return image


_compiled = njit(cache=True, error_model="numpy", fastmath=True, nogil=True)


# Compiled functions. SAMPLES x SAMPLES rays a pixel, rows downwards, all vectors in the camera's frame; `scale`: rays
# per metre. The surface that each ray meets first stands in `depth` (z [m]), `normal` (unit vector) and `member`
# (position among the cones, -1: no surface, -2: the box).


@_compiled
def _draw(volumes, colours, box, box_axes, half, box_colour, scale, light, vertical, paper, image):  # type: ignore[no-untyped-def]
    rows, columns = SAMPLES * image.shape[0], SAMPLES * image.shape[1]
    depth = np.full((rows, columns), FAR)
    normal = np.zeros((rows, columns, 3), np.float32)
    member = np.full((rows, columns), -1, np.int32)
    total = np.zeros(image.shape, np.float32)
    _cast_box(box, box_axes, half, scale, depth, normal, member)
    for n in range(volumes.shape[0]):
        _cast_cone(n, volumes[n], scale, depth, normal, member)
    across, away = _level(vertical)
    casters = _casters(volumes, box, across, away, vertical)
    for i in range(rows):
        for j in range(columns):
            n = member[i, j]
            if n == -1:
                for c in range(3):
                    total[i // SAMPLES, j // SAMPLES, c] += paper[c]
                continue
            nx, ny, nz = normal[i, j, 0], normal[i, j, 1], normal[i, j, 2]
            bright, shine = _lit(nx, ny, nz, light)
            if n >= 0:
                bright *= 0.80 + 0.20 * math.sqrt(max(nz, 0.0))
            else:
                shine = 0.0
                if nx * vertical[0] + ny * vertical[1] + nz * vertical[2] > 0.5:
                    x, y = (j + 0.5 - 0.5 * columns) / scale, (0.5 * rows - i - 0.5) / scale
                    bright *= 1.0 - 0.42 * min(1.0, 1.6 * _shadow(x, y, depth[i, j], casters, across, away, vertical))
            edge = 0.0
            if 0 < i < rows - 1 and 0 < j < columns - 1:
                edge = _outline(depth[i, j], depth[i - 1, j], depth[i + 1, j], depth[i, j - 1], depth[i, j + 1])
            for c in range(3):
                colour = colours[n, c] if n >= 0 else box_colour[c]
                value = min(1.0, colour * bright + shine)
                total[i // SAMPLES, j // SAMPLES, c] += value * (1.0 - edge) + edge * 0.22 * colour
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            for c in range(3):
                image[i, j, c] = int(255.0 / SAMPLES**2 * total[i, j, c] + 0.5)


@_compiled
def _cast_box(box, box_axes, half, scale, depth, normal, member):  # type: ignore[no-untyped-def]
    """Enters the box: the common part of three slabs along its axes."""
    rows, columns = depth.shape
    wide = abs(box_axes[0, 0]) * half[0] + abs(box_axes[1, 0]) * half[1] + abs(box_axes[2, 0]) * half[2]
    high = abs(box_axes[0, 1]) * half[0] + abs(box_axes[1, 1]) * half[1] + abs(box_axes[2, 1]) * half[2]
    first, last = _span(rows, scale, -box[1] - high, -box[1] + high)
    left, right = _span(columns, scale, box[0] - wide, box[0] + wide)
    for i in range(first, last):
        y = (0.5 * rows - i - 0.5) / scale - box[1]
        for j in range(left, right):
            x = (j + 0.5 - 0.5 * columns) / scale - box[0]
            enter, leave, side, sign = -1e9, 1e9, -1, 1.0  # along -z
            for k in range(3):
                start = box_axes[k, 0] * x + box_axes[k, 1] * y - box_axes[k, 2] * box[2]
                slope = -box_axes[k, 2]
                if abs(slope) < 1e-9:
                    if abs(start) > half[k]:
                        enter, leave = 1e9, -1e9
                    continue
                a, b = (-half[k] - start) / slope, (half[k] - start) / slope
                if min(a, b) > enter:
                    enter, side, sign = min(a, b), k, -1.0 if slope > 0 else 1.0
                leave = min(leave, max(a, b))
            if enter < leave and side >= 0:
                depth[i, j] = -enter
                member[i, j] = -2
                for c in range(3):
                    normal[i, j, c] = sign * box_axes[side, c]


@_compiled
def _span(count, scale, low, high):  # type: ignore[no-untyped-def]
    """First and one past the last of `count` rays that pass between `low` and `high` [m] from the middle."""
    return max(0, int(0.5 * count + low * scale)), min(count, int(0.5 * count + high * scale) + 2)


@_compiled
def _cast_cone(n, cone, scale, depth, normal, member):  # type: ignore[no-untyped-def]
    """Enters cone `n` for the rays that meet it before any surface entered so far."""
    rows, columns = depth.shape
    ax, ay, az, bx, by, bz, ra, rb = cone
    dx, dy, dz, dr = bx - ax, by - ay, bz - az, ra - rb
    length = dx * dx + dy * dy + dz * dz
    inner = length - dr * dr
    k2 = inner - dz * dz
    first, last = _span(rows, scale, -max(ay + ra, by + rb), -min(ay - ra, by - rb))
    left, right = _span(columns, scale, min(ax - ra, bx - rb), max(ax + ra, bx + rb))
    for i in range(first, last):
        y = (0.5 * rows - i - 0.5) / scale
        for j in range(left, right):
            x = (j + 0.5 - 0.5 * columns) / scale
            ox, oy, oz = x - ax, y - ay, -az
            m1 = dx * ox + dy * oy + dz * oz
            m5 = ox * ox + oy * oy + oz * oz
            best, nx, ny, nz = FAR, 0.0, 0.0, 0.0
            if inner > 0.0:  # the mantle
                k1 = -inner * oz + m1 * dz - dz * dr * ra
                k0 = inner * m5 - m1 * m1 + 2.0 * m1 * dr * ra - length * ra * ra
                h = k1 * k1 - k0 * k2
                if h >= 0.0 and k2 > 1e-12:
                    t = (-math.sqrt(h) - k1) / k2
                    along = m1 - ra * dr - t * dz
                    if 0.0 < along < inner:
                        best = -t
                        nx, ny, nz = inner * ox - dx * along, inner * oy - dy * along, inner * (oz - t) - dz * along
            if best == FAR:  # the balls at its ends
                h = oz * oz - m5 + ra * ra
                if h > 0.0:
                    z = az + math.sqrt(h)
                    best, nx, ny, nz = z, ox, oy, z - az
                px, py = x - bx, y - by
                h = rb * rb - px * px - py * py
                if h > 0.0 and bz + math.sqrt(h) > best:
                    z = bz + math.sqrt(h)
                    best, nx, ny, nz = z, px, py, z - bz
            if best > depth[i, j]:
                size = math.sqrt(nx * nx + ny * ny + nz * nz)
                depth[i, j] = best
                member[i, j] = n
                normal[i, j, 0], normal[i, j, 1], normal[i, j, 2] = nx / size, ny / size, nz / size


@_compiled
def _level(vertical):  # type: ignore[no-untyped-def]
    """Two horizontal axes; the camera is level, so that its x axis is one of them."""
    across = np.array([vertical[1], -vertical[0], 0.0])
    away = np.array(
        [
            across[1] * vertical[2] - across[2] * vertical[1],
            across[2] * vertical[0] - across[0] * vertical[2],
            across[0] * vertical[1] - across[1] * vertical[0],
        ]
    )
    return across, away


@_compiled
def _casters(volumes, box, across, away, vertical):  # type: ignore[no-untyped-def]
    """(m, 7) the volumes low enough to throw a shadow on the box: both ends (across, away, up) and a radius [m]."""
    casters = np.empty((volumes.shape[0], 7))
    floor = box[0] * vertical[0] + box[1] * vertical[1] + box[2] * vertical[2]
    count = 0
    for n in range(volumes.shape[0]):
        for e in range(2):
            v = volumes[n, 3 * e : 3 * e + 3]
            casters[count, 3 * e] = v[0] * across[0] + v[1] * across[1] + v[2] * across[2]
            casters[count, 3 * e + 1] = v[0] * away[0] + v[1] * away[1] + v[2] * away[2]
            casters[count, 3 * e + 2] = v[0] * vertical[0] + v[1] * vertical[1] + v[2] * vertical[2]
        casters[count, 6] = 1.25 * max(volumes[n, 6], volumes[n, 7]) + 0.012
        if min(casters[count, 2], casters[count, 5]) < floor + SHADOWING:
            count += 1
    return casters[:count]


@_compiled
def _lit(nx, ny, nz, light):  # type: ignore[no-untyped-def]
    """Brightness of a surface with that normal, and its highlight."""
    toward = nx * light[0] + ny * light[1] + nz * light[2]
    lit = 0.5 + 0.5 * toward
    shine = max(0.0, 2.0 * toward * nz - light[2]) ** 2
    shine = shine * shine * shine
    return 0.62 + 0.42 * lit * math.sqrt(lit), 0.10 * shine * shine * shine * shine


@_compiled
def _shadow(x, y, z, casters, across, away, vertical):  # type: ignore[no-untyped-def]
    """0...1: depth of the shadow at a point of the box, 1 close below the axis of a caster."""
    p = x * across[0] + y * across[1] + z * across[2]
    q = x * away[0] + y * away[1] + z * away[2]
    h = x * vertical[0] + y * vertical[1] + z * vertical[2]
    shade = 0.0
    for k in range(casters.shape[0]):
        px, py = casters[k, 0] - p, casters[k, 1] - q
        sx, sy = casters[k, 3] - casters[k, 0], casters[k, 4] - casters[k, 1]
        square = sx * sx + sy * sy
        t = 0.0 if square < 1e-12 else min(1.0, max(0.0, -(px * sx + py * sy) / square))
        px, py = px + t * sx, py + t * sy
        d = (px * px + py * py) / (casters[k, 6] * casters[k, 6])
        if d < 1.0:
            height = max(0.0, casters[k, 2] + t * (casters[k, 5] - casters[k, 2]) - h)
            shade = max(shade, (1.0 - d) * math.exp(-4.0 * height))
    return shade


@_compiled
def _outline(here, up, down, left, right):  # type: ignore[no-untyped-def]
    """How dark the outline is: where a neighbour's depth lies far behind and none far in front."""
    jump = max(up - here, down - here, left - here, right - here)
    fall = max(here - up, here - down, here - left, here - right)
    return 0.55 if fall > 0.03 and jump < 0.03 else 0.0
