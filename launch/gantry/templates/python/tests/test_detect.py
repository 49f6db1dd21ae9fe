"""The detector on images of a few pixels."""

import numpy as np

from {{name}}.detect import CAR, cars


def test_two_cars_side_by_side_get_a_box_each_and_a_lamp_gets_none():
    image = np.zeros((10, 20), np.uint8)
    image[2:6, 1:7] = CAR
    image[4:9, 10:15] = CAR
    image[5, 18] = CAR
    boxes = cars(image)
    assert boxes["min_px"].tolist() == [[1, 2], [10, 4]]
    assert boxes["max_px"].tolist() == [[7, 6], [15, 9]]


def test_an_image_without_cars_has_no_boxes():
    assert len(cars(np.zeros((4, 4), np.uint8))) == 0
