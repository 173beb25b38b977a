"""Round cones and one box under parallel light and a parallel camera: a small ray caster that needs no OpenGL, no
display and no driver.

Camera frame: x right, y up, z towards the viewer. Intersection of a ray with a round cone after I. Quilez, "Ray-surface
intersectors" (iquilezles.org/articles/intersectors), specialised to rays along -z."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

SAMPLES = 2  # per pixel and direction
LIGHT = np.array([-0.42, 0.78, 0.46])  # towards it, in the camera's frame; the shadow falls along the world's vertical
SHADOWING = 0.35  # m above the box up to which a volume throws a shadow
FAR = -1e9  # depth of a ray that meets nothing
NOTHING, BOX = -2, -1  # in place of a cone's position
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
        cut: np.ndarray | None = None,
    ) -> np.ndarray:
        """(height, width, 3) uint8: round cones and one box.

        - volumes: (n, 8) round cones, as Skeleton.volumes gives them, in `colours` (n, 3) of 0...1
        - box: (3,) middle of the box [m]; turn: (3, 3) its axes as rows; half: (3,) its half extents [m]
        - box_colour: (3,) of 0...1
        - cut: (4,) of the box is there what lies up to cut[3] [m] from its middle along cut[:3], a unit vector in the
          box's own axes; None: all
        """
        t = self.turn
        cones = np.empty_like(volumes)
        cones[:, :3], cones[:, 3:6], cones[:, 6:] = (
            (volumes[:, :3] - self.centre) @ t.T,
            (volumes[:, 3:6] - self.centre) @ t.T,
            volumes[:, 6:],
        )
        box = (box - self.centre) @ t.T
        rays = _Rays(SAMPLES * self.height, SAMPLES * self.width, SAMPLES * self.scale)
        rays.cast_box(box, turn @ t.T, half, cut)
        for n, cone in enumerate(cones):
            rays.cast_cone(n, *map(float, cone))
        return _shaded(rays, cones, np.vstack([colours, box_colour]), box, t @ [0.0, 1.0, 0.0])


class _Rays:
    """SAMPLES x SAMPLES rays a pixel along -z, rows downwards, all vectors in the camera's frame. Of the surface that
    each ray meets first:

    - depth: (rows, columns) z [m]; FAR: none
    - normal: (3, rows, columns) unit vector
    - member: (rows, columns) position among the cones; NOTHING, BOX
    """

    def __init__(self, rows: int, columns: int, scale: float) -> None:
        """`scale`: rays per metre."""
        self.scale = scale
        self.x = (np.arange(columns) + 0.5 - 0.5 * columns) / scale
        self.y = (0.5 * rows - np.arange(rows) - 0.5) / scale
        self.depth = np.full((rows, columns), FAR)
        self.normal = np.zeros((3, rows, columns), np.float32)
        self.member = np.full((rows, columns), NOTHING, np.int32)

    def _part(self, left: float, right: float, low: float, high: float) -> tuple[slice, slice]:
        """The rays between two limits [m] in each direction."""
        rows, columns = self.depth.shape
        return (
            slice(max(0, int(0.5 * rows - high * self.scale)), min(rows, int(0.5 * rows - low * self.scale) + 2)),
            slice(
                max(0, int(0.5 * columns + left * self.scale)),
                min(columns, int(0.5 * columns + right * self.scale) + 2),
            ),
        )

    def cast_box(self, box: np.ndarray, axes: np.ndarray, half: np.ndarray, cut: np.ndarray | None) -> None:
        """Enters the box: the common part of three slabs along its axes, and of the half space of a cut."""
        normals = list(axes) if cut is None else [*axes, cut[:3] @ axes]
        ends = [(-float(h), float(h)) for h in half] + ([] if cut is None else [(FAR, float(cut[3]))])
        wide, high, _ = np.abs(axes).T @ half
        part = self._part(box[0] - wide, box[0] + wide, box[1] - high, box[1] + high)
        x, y = self.x[part[1]] - box[0], (self.y[part[0]] - box[1])[:, None]
        shape = (y.shape[0], x.shape[0])
        enter, leave, side = np.full(shape, FAR), np.full(shape, -FAR), np.full(shape, -1)
        for k, (normal, (low, high)) in enumerate(zip(normals, ends, strict=True)):
            start, slope = normal[0] * x + normal[1] * y - normal[2] * box[2], -normal[2]
            if abs(slope) < 1e-9:
                leave[(start < low) | (start > high)] = FAR
                continue
            one, other = (low - start) / slope, (high - start) / slope
            first, last = (one, other) if slope > 0 else (other, one)
            side[first > enter] = k
            np.maximum(enter, first, out=enter)
            np.minimum(leave, last, out=leave)
        hit = np.nonzero((enter < leave) & (side >= 0))
        rows, columns = hit[0] + part[0].start, hit[1] + part[1].start
        self.depth[rows, columns], self.member[rows, columns] = -enter[hit], BOX
        outward = np.array([math.copysign(1.0, normal[2]) * normal for normal in normals])
        self.normal[:, rows, columns] = outward[side[hit]].T

    def cast_cone(
        self, n: int, ax: float, ay: float, az: float, bx: float, by: float, bz: float, ra: float, rb: float
    ) -> None:
        """Enters cone `n` for the rays that meet it before any surface entered so far."""
        part = self._part(min(ax - ra, bx - rb), max(ax + ra, bx + rb), min(ay - ra, by - rb), max(ay + ra, by + rb))
        dx, dy, dz, dr = bx - ax, by - ay, bz - az, ra - rb
        length = dx * dx + dy * dy + dz * dz
        inner = length - dr * dr
        ox, oy, oz = self.x[part[1]] - ax, (self.y[part[0]] - ay)[:, None], -az
        square = ox * ox + oy * oy
        # the balls at its ends
        h = ra * ra - square
        depth = np.where(h > 0.0, az + np.sqrt(np.maximum(h, 0.0)), FAR)
        which = np.zeros(depth.shape, np.int8)
        h = rb * rb - ((ox - dx) ** 2 + (oy - dy) ** 2)
        other = np.where(h > 0.0, bz + np.sqrt(np.maximum(h, 0.0)), FAR)
        which[other > depth] = 1
        np.maximum(depth, other, out=depth)
        k2 = inner - dz * dz
        if inner > 0.0 and k2 > 1e-12:  # the mantle
            m1 = dx * ox + dy * oy + dz * oz
            k1 = m1 * dz - (inner * oz + dz * dr * ra)
            k0 = inner * (square + oz * oz) - m1 * (m1 - 2.0 * dr * ra) - length * ra * ra
            h = k1 * k1 - k0 * k2
            t = (-np.sqrt(np.maximum(h, 0.0)) - k1) / k2
            along = m1 - ra * dr - t * dz
            mantle = (h >= 0.0) & (along > 0.0) & (along < inner)
            depth[mantle], which[mantle] = -t[mantle], 2
        hit = np.nonzero(depth > self.depth[part])
        rows, columns = hit[0] + part[0].start, hit[1] + part[1].start
        z, end = depth[hit], which[hit]
        nx, ny, nz = ox[hit[1]], oy[hit[0], 0], z - az
        back = (end == 1).astype(float)
        if inner > 0.0 and k2 > 1e-12:
            back[end == 2] = along[hit][end == 2] / inner
        nx, ny, nz = nx - dx * back, ny - dy * back, nz - dz * back
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        self.depth[rows, columns], self.member[rows, columns] = z, n
        self.normal[:, rows, columns] = nx / size, ny / size, nz / size


def _shaded(rays: _Rays, cones: np.ndarray, colours: np.ndarray, box: np.ndarray, vertical: np.ndarray) -> np.ndarray:
    """The picture; `colours`: of the cones and, last, of the box."""
    light = LIGHT / np.linalg.norm(LIGHT)
    rows, columns = np.nonzero(rays.member != NOTHING)
    n, depth = rays.member[rows, columns], rays.depth[rows, columns]
    normal = rays.normal[:, rows, columns]
    toward = light.astype(np.float32) @ normal
    lit = 0.5 + 0.5 * toward
    bright = 0.62 + 0.42 * lit * np.sqrt(np.maximum(lit, 0.0))
    shine = 0.10 * np.maximum(0.0, 2.0 * toward * normal[2] - light[2]) ** 24
    body = n >= 0
    bright = np.where(body, bright * (0.80 + 0.20 * np.sqrt(np.maximum(normal[2], 0.0))), bright)
    shine = np.where(body, shine, 0.0)
    top = np.flatnonzero(~body & (vertical.astype(np.float32) @ normal > 0.5))
    points = np.array([rays.x[columns[top]], rays.y[rows[top]], depth[top]])
    bright[top] *= 1.0 - 0.42 * np.minimum(1.0, 1.6 * _shadow(points, cones, box, vertical))
    edge = _outlines(rays.depth, rows, columns)
    value = np.minimum(1.0, colours[n] * bright[:, None] + shine[:, None])
    value = value * (1.0 - edge)[:, None] + colours[n] * (0.22 * edge)[:, None]
    height, width = rays.member.shape[0] // SAMPLES, rays.member.shape[1] // SAMPLES
    pixel = (rows // SAMPLES) * width + columns // SAMPLES
    free = SAMPLES**2 - np.bincount(pixel, minlength=height * width)
    total = np.stack([np.bincount(pixel, value[:, c], height * width) + free * PAPER[c] for c in range(3)], axis=1)
    return (255.0 / SAMPLES**2 * total + 0.5).astype(np.uint8).reshape(height, width, 3)


def _shadow(points: np.ndarray, cones: np.ndarray, box: np.ndarray, vertical: np.ndarray) -> np.ndarray:
    """(n,) 0...1: depth of the shadow at `points` (3, n) of the box, 1 close below the axis of a volume."""
    across = np.array([vertical[1], -vertical[0], 0.0])  # the camera is level: its x axis is one of the horizontal ones
    level = np.array([across, np.cross(across, vertical), vertical])
    p, q, h = level @ points
    ends = np.stack([cones[:, :3] @ level.T, cones[:, 3:6] @ level.T], axis=1)
    reach = 1.25 * np.maximum(cones[:, 6], cones[:, 7]) + 0.012
    shade = np.zeros(points.shape[1])
    for n in np.flatnonzero(ends[:, :, 2].min(axis=1) < box @ vertical + SHADOWING):
        (ax, ay, az), (bx, by, bz) = ends[n]
        px, py, sx, sy = ax - p, ay - q, bx - ax, by - ay
        square = sx * sx + sy * sy
        t = np.clip(-(px * sx + py * sy) / square, 0.0, 1.0) if square >= 1e-12 else np.zeros_like(p)
        d = ((px + t * sx) ** 2 + (py + t * sy) ** 2) / reach[n] ** 2
        below = np.flatnonzero(d < 1.0)
        height = np.maximum(0.0, az + t[below] * (bz - az) - h[below])
        shade[below] = np.maximum(shade[below], (1.0 - d[below]) * np.exp(-4.0 * height))
    return shade


def _outlines(depth: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """How dark the outline is at those rays: where a neighbour's depth lies far behind and none far in front."""
    low, high = np.full(len(rows), np.inf), np.full(len(rows), -np.inf)
    last, end = depth.shape[0] - 1, depth.shape[1] - 1
    for di, dj in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        beside = depth[np.clip(rows + di, 0, last), np.clip(columns + dj, 0, end)]
        np.minimum(low, beside, out=low)
        np.maximum(high, beside, out=high)
    here = depth[rows, columns]
    inside = (rows > 0) & (rows < last) & (columns > 0) & (columns < end)
    return np.where(inside & (here - low > 0.03) & (high - here < 0.03), 0.55, 0.0)
