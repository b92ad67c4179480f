"""Masks of what stands still in the images while the vehicle moves: legs, struts, cables, dirt on a lens.

In the mean of many views the edges of the scene fade, and those of the vehicle stay: a block of pixels shows the vehicle if the gradients
of the mean image are nearly as strong as those of its single images. Turning rotors are not found.
"""

import numpy as np
from PIL import Image
from scipy import ndimage
from tqdm import tqdm

from . import LabError, recordings

BLOCK_PX = 8
# Views are this far apart, s, and differ by this many grey levels in a quarter of their blocks.
APART_S = 0.2
CHANGE_LEVELS = 4
CHANGED_SHARE = 0.25
LEAST_VIEWS = 30
# Share of the gradients that the mean image of a block keeps where the vehicle is seen, and their least strength, levels/px.
KEPT_SHARE = 0.5
LEAST_GRADIENT = 1.5
# Blocks between two edges of the vehicle that belong to it.
CLOSED_BLOCKS = 3
# A mask that leaves less of an image is refused: the scene stood still.
LEAST_SEEN_SHARE = 0.5


def blocks(values: np.ndarray) -> np.ndarray:
    """Means of blocks of pixels."""
    rows, columns = (np.arange(0, size, BLOCK_PX) for size in values.shape)
    sums = np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)
    counts = np.outer(np.diff(np.r_[rows, values.shape[0]]), np.diff(np.r_[columns, values.shape[1]]))
    return sums / counts


def strengths(levels: np.ndarray) -> np.ndarray:
    """Strengths of the gradients, levels/px; 0 at the rim."""
    result = np.zeros_like(levels)
    across, down = levels[1:-1, 2:] - levels[1:-1, :-2], levels[2:, 1:-1] - levels[:-2, 1:-1]
    result[1:-1, 1:-1] = 0.5 * (np.abs(across) + np.abs(down))
    return result


def find(images, margin_px: int) -> tuple[np.ndarray, int] | None:
    """Mask from the images of a camera, `True` where the scene is seen, and the number of views; `None` without an image."""
    levels = gradients = last = last_ns = None
    count = 0
    for stamp_ns, picture in tqdm(images, unit="image", disable=None):
        if last is not None and stamp_ns - last_ns < APART_S * 1e9:
            continue
        image = recordings.levels(picture)
        if last is not None and (blocks(np.abs(image - last)) >= CHANGE_LEVELS).mean() < CHANGED_SHARE:
            continue
        levels = image if levels is None else levels + image
        gradients = strengths(image) if gradients is None else gradients + strengths(image)
        last, last_ns, count = image, stamp_ns, count + 1
    if last is None:
        return None
    if count < LEAST_VIEWS:
        raise LabError(
            f"{count} views differ from each other, and {LEAST_VIEWS} are needed: record a flight, or carry the vehicle through a "
            "textured room for half a minute"
        )
    of_mean, each = blocks(strengths(levels / count)), blocks(gradients / count)
    hidden = (of_mean >= KEPT_SHARE * each) & (of_mean >= LEAST_GRADIENT)
    square = lambda reach: np.ones((2 * reach + 1, 2 * reach + 1), bool)  # noqa: E731
    hidden = ndimage.binary_dilation(hidden, square(CLOSED_BLOCKS))
    # Beyond the rim there is nothing to see.
    hidden = ndimage.binary_erosion(hidden, square(CLOSED_BLOCKS), border_value=1)
    hidden = ndimage.binary_dilation(hidden, square(-(-margin_px // BLOCK_PX)))
    seen = ~np.kron(hidden, np.ones((BLOCK_PX, BLOCK_PX), bool))[: levels.shape[0], : levels.shape[1]]
    return seen, count


def run(args) -> None:
    """Writes a mask for each camera that sees its vehicle."""
    outs = [args.out / f"{side}-mask.png" for side in ("left", "right")]
    existing = next((out for out in outs if out.exists() and not args.overwrite), None)
    if existing:
        raise LabError(f"{existing}: exists; name another folder, or give --overwrite")
    args.out.mkdir(parents=True, exist_ok=True)
    found = 0
    for camera, (side, out) in enumerate(zip(("left", "right"), outs)):
        masked = find(recordings.images(args.recording, camera), args.margin_px)
        if masked is None and camera == 0:
            raise LabError(f"{args.recording}: holds no image of the left camera; record with recorder.images")
        if masked is None:
            continue
        seen, views = masked
        if seen.mean() < LEAST_SEEN_SHARE:
            raise LabError(f"most of the {side} image stands still ({100 * (1 - seen.mean()):.0f} %): move through a textured scene")
        if seen.all():
            print(f"{side}: nothing of the vehicle is in view, by {views} views; no mask is needed")
            continue
        Image.fromarray((255 * seen).astype(np.uint8)).save(out)
        found += 1
        print(f"{out}: {100 * (1 - seen.mean()):.1f} % of the {side} image, from {views} views")
        print(f'  in the configuration, in the {"first" if camera == 0 else "second"} [[camera]]:  mask = "{out.name}"')
    if not found:
        print("no mask is written")
