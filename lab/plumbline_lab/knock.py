"""Copies of data sets whose cameras are knocked: from a moment on, for good or to and fro, both look as if turned on the body.

Angle, axis and moment are drawn: 2 to 20 degrees, evenly by the logarithm, about any axis of the body, 6 to 18 s after the first frame; odd
draws go to and fro every 0.3 to 3 s. The images are those of the data set, turned about the optical centre; beyond their rim is black.
"""

import random
import shutil

import numpy as np
import yaml
from PIL import Image
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from . import LabError, recordings


def looked_up(camera: dict, turn_b: Rotation) -> np.ndarray:
    """Row and column, in the image of a camera of the radial-tangential model, of each pixel of the one that is turned on the body."""
    (width, height), (fu, fv, cu, cv) = camera["resolution"], camera["intrinsics"]
    k1, k2, p1, p2 = camera["distortion_coefficients"]

    def bent(xy):
        (x, y), r2 = xy, (xy**2).sum(0)
        shift = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y])
        return xy * (1 + k1 * r2 + k2 * r2 * r2) + shift

    row, column = np.mgrid[:height, :width]
    seen = xy = np.stack([(column - cu) / fu, (row - cv) / fv])
    for _ in range(20):
        xy = seen - (bent(xy) - xy)
    rot_b_c = Rotation.from_matrix(np.reshape(camera["T_BS"]["data"], (4, 4))[:3, :3])
    ray = np.stack([*xy, np.ones((height, width))]).reshape(3, -1)
    x, y, z = (rot_b_c.inv() * turn_b * rot_b_c).apply(ray.T).T.reshape(3, height, width)
    u, v = bent(np.stack([x, y]) / z)
    return np.where(z > 0.1, [v * fv + cv, u * fu + cu], -1)


def run(args) -> None:
    """Writes the copy."""
    root, draw = recordings.mav0(args.dataset), random.Random(args.draw)
    if root is None or args.out.exists():
        raise LabError(f"{args.dataset}: is no data set" if root is None else f"{args.out}: exists; name another folder")
    angle, axis = np.radians(2 * 10 ** draw.random()), np.array([draw.gauss(0, 1) for _ in range(3)])
    at_s, every_s = draw.uniform(6, 18), draw.uniform(0.3, 3) if args.draw % 2 else np.inf
    turn_b = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    stamps_ns = [int(file.stem) for file in (root / "cam0" / "data").glob("*.png")]
    first_ns, length_s = min(stamps_ns), (max(stamps_ns) - min(stamps_ns)) * 1e-9
    if length_s < at_s:
        raise LabError(f"{args.dataset}: has {length_s:.1f} s; draw {args.draw} knocks the cameras after {at_s:.1f} s")
    shutil.copytree(root, args.out / "mav0")
    for folder in sorted((args.out / "mav0").glob("cam?")):
        at = looked_up(yaml.safe_load((folder / "sensor.yaml").read_text()), turn_b)
        for file in (folder / "data").glob("*.png"):
            since_s = (int(file.stem) - first_ns) * 1e-9 - at_s
            if since_s >= 0 and since_s // every_s % 2 == 0:
                turned = map_coordinates(np.asarray(Image.open(file), float), at, order=1)
                Image.fromarray(np.rint(turned).astype(np.uint8)).save(file, compress_level=1)
    course = f"to and fro every {every_s:.1f} s" if args.draw % 2 else "for good"
    print(f"{args.out}: turned by {np.degrees(angle):.1f} degrees from {at_s:.1f} s on, {course}")
