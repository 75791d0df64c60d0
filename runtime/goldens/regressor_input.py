"""Writes runtime/goldens/regressor_input.npy: the crops of person_crop.py as PyTorch gives them to a network.

    python runtime/goldens/regressor_input.py        (from the repository's root; needs NumPy, Pillow and PyTorch)

Photograph -> crop -> Pillow's bilinear resize -> /255 -> (x - mean) / std with ImageNet's numbers, in f32, as torchvision's
to_tensor and normalize do: every case's [3,S,S], one after the other.
"""

import numpy as np
import person_crop
import torch

MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


def network_input(pixels: np.ndarray) -> torch.Tensor:
    image = torch.from_numpy(pixels.copy()).permute(2, 0, 1).to(torch.float32).div(255)
    mean, std = (torch.tensor(numbers).view(3, 1, 1) for numbers in (MEAN, STD))
    return image.sub(mean).div(std)


def main() -> None:
    photograph = person_crop.photograph()
    crops = [person_crop.crop(photograph, center, side, size)[2] for _, center, side, size in person_crop.CASES]
    inputs = torch.cat([network_input(crop).flatten() for crop in crops])
    np.save("runtime/goldens/regressor_input.npy", inputs.numpy())


if __name__ == "__main__":
    main()
