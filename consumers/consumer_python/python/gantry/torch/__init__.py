"""What was recorded or exported, as data sets of torch: for training detectors.

    import gantry.torch

    if __name__ == "__main__":
        made = gantry.torch.Dataset("set/coco", "drive.mcap", classes=["person", "car"], part="train")
        for images, targets in gantry.torch.loader(made, batch_size=8, shuffle=True, workers=2):
            losses = model(list(images), list(targets))       # as detectors of torchvision take them

Workers are started anew (`spawn`) and import your script, which is why its work stands under
`if __name__ == "__main__"`. It needs torch, which is imported when the first image is asked for.
"""

from ._dataset import Dataset, collate, loader
from ._samples import CATEGORY_NAMES, Sample

__all__ = ["CATEGORY_NAMES", "Dataset", "Sample", "collate", "loader"]
