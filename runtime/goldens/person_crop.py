"""Writes runtime/src/person_crop/goldens.rs: crops of a made-up photograph as Pillow resizes them.

    python runtime/goldens/person_crop.py        (from the repository's root; needs NumPy and Pillow)

The square is found by the arithmetic of SPIN's `utils/imutils.py` (`transform` and `crop`), written anew here: a matrix
from photograph to crop, inverted, applied to the corners of the crop, truncated to integers. Where the two sides differ
by the truncation, the longer is taken for both.
"""

from pathlib import Path

import numpy as np
import PIL
from PIL import Image

WIDTH, HEIGHT = 96, 64
CASES = [
    ("down", (47.3, 31.8), 50.4, 12),
    ("up", (30.0, 44.0), 9.0, 16),
    ("slightly up", (60.25, 33.1), 13.7, 15),
    ("beyond two borders", (8.2, 55.9), 61.0, 12),
    ("beyond all borders", (48.0, 32.0), 130.6, 12),
]


def photograph():
    u, v, c = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT), np.arange(3), indexing="xy")
    smooth = 2 * u + 3 * v + 20 * c
    noise = 7 * u * u + 13 * v * v + 5 * u * v + 31 * c * (u + 2 * v)
    return (np.where(2 * v < HEIGHT, smooth, noise) % 256).astype(np.uint8)


def corner(crop_pixel, center, side, size):
    """The photograph pixel, counted from 1, that holds a crop pixel counted from 1."""
    to_crop = np.array(
        [
            [size / side, 0, size * (-center[0] / side + 0.5)],
            [0, size / side, size * (-center[1] / side + 0.5)],
            [0, 0, 1],
        ]
    )
    found = np.linalg.inv(to_crop) @ [crop_pixel[0] - 1, crop_pixel[1] - 1, 1]
    return found[:2].astype(int) + 1


def crop(image, center, side, size):
    low = corner((1, 1), center, side, size) - 1
    high = corner((size + 1, size + 1), center, side, size) - 1
    cut = int((high - low).max())
    padded = np.zeros((cut, cut, 3), np.uint8)
    rows, columns = np.arange(cut) + low[1], np.arange(cut) + low[0]
    inside = np.ix_((rows >= 0) & (rows < HEIGHT), (columns >= 0) & (columns < WIDTH))
    padded[inside] = image[rows[(rows >= 0) & (rows < HEIGHT)]][:, columns[(columns >= 0) & (columns < WIDTH)]]
    return low, cut, np.asarray(Image.fromarray(padded).resize((size, size), Image.Resampling.BILINEAR))


def main():
    lines = [
        f"//! Crops by Pillow {PIL.__version__}, written by runtime/goldens/person_crop.py.",
        "",
        "/// What was asked of Pillow, and its answer.",
        "#[derive(Debug)]",
        "pub struct Golden {",
        "    pub name: &'static str,",
        "    pub center_px: [f64; 2],",
        "    pub side_px: f64,",
        "    pub size: u32,",
        "    pub origin_px: [i64; 2],",
        "    pub cut_px: u32,",
        "    pub pixels: &'static [u8],",
        "}",
        "",
        f"pub const WIDTH: u32 = {WIDTH};",
        f"pub const HEIGHT: u32 = {HEIGHT};",
        "",
        "#[rustfmt::skip]",
        f"pub const GOLDENS: [Golden; {len(CASES)}] = [",
    ]
    image = photograph()
    for name, center, side, size in CASES:
        low, cut, pixels = crop(image, center, side, size)
        lines += [
            "    Golden {",
            f'        name: "{name}",',
            f"        center_px: [{center[0]}, {center[1]}],",
            f"        side_px: {side}, size: {size},",
            f"        origin_px: [{low[0]}, {low[1]}], cut_px: {cut},",
            "        pixels: &[",
        ]
        lines += ["            " + "".join(f"{p}," for p in row.reshape(-1)) for row in pixels]
        lines += ["        ],", "    },"]
    lines += ["];", ""]
    Path("runtime/src/person_crop/goldens.rs").write_text("\n".join(lines))


if __name__ == "__main__":
    main()
