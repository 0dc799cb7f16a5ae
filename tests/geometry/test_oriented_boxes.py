import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import normalise, to_matrix
from safe_inspect.geometry.oriented_boxes import OrientedBoxes


def _boxes(n=4, seed=0):
    generator = np.random.default_rng(seed)
    return OrientedBoxes(
        generator.uniform(-1.0, 1.0, (n, 3)),
        generator.uniform(0.1, 0.6, (n, 3)),
        to_matrix(normalise(generator.normal(size=(n, 4)))),
    )


def _points(n=500, seed=1):
    return np.random.default_rng(seed).uniform(-2.0, 2.0, (n, 3))


def test_the_distance_outside_is_that_to_the_nearest_point_of_the_box():
    boxes, points = _boxes(1), _points()
    local = (points - boxes.centre[0]) @ boxes.rotation[0]
    nearest = np.clip(local, -boxes.half_size[0], boxes.half_size[0])
    outside = np.linalg.norm(local - nearest, axis=1)
    distance = boxes.distance(points)
    assert np.allclose(distance[outside > 0.0], outside[outside > 0.0], atol=1e-15)
    inside = outside == 0.0
    assert inside.any()
    assert np.allclose(distance[inside], -(boxes.half_size[0] - np.abs(local[inside])).min(axis=1), atol=1e-15)


def test_the_gradient_is_the_slope_of_the_distance():
    boxes, points = _boxes(), _points()
    distance, gradient = boxes.distances(points)
    step = 1e-6
    slopes = np.stack(
        [
            (boxes.distances(points + step * e)[0] - boxes.distances(points - step * e)[0]) / (2 * step)
            for e in np.eye(3)
        ],
        axis=-1,
    )
    smooth = np.linalg.norm(slopes, axis=2) > 1.0 - 1e-6  # not across an edge of an interior
    assert smooth.mean() > 0.98
    assert np.abs(slopes - gradient)[smooth].max() < 1e-8
    assert np.allclose(np.linalg.norm(gradient, axis=2), 1.0, atol=1e-14)
    assert (boxes.distance(points) == distance.min(axis=1)).all()


def test_the_distance_to_the_union_is_1_lipschitz():
    boxes, a, b = _boxes(), _points(seed=2), _points(seed=3)
    change = np.abs(boxes.distance(a) - boxes.distance(b))
    assert (change <= np.linalg.norm(a - b, axis=1) + 1e-12).all()


def test_at_the_centre_the_gradient_is_an_axis_of_the_box():
    boxes = OrientedBoxes(np.zeros((1, 3)), np.array([[3.0, 2.0, 1.0]]), np.eye(3)[None])
    distance, gradient = boxes.distances(np.zeros((1, 3)))
    assert distance.tolist() == [[-1.0]]
    assert gradient.tolist() == [[[0.0, 0.0, 1.0]]]


def test_shapes_that_do_not_fit_are_rejected():
    with pytest.raises(ValueError, match=r"boxes: rotation must have the shape \(B, 3, 3\)"):
        OrientedBoxes(np.zeros((1, 3)), np.ones((1, 3)), np.eye(3))
    with pytest.raises(ValueError, match="half_size must be positive"):
        OrientedBoxes(np.zeros((1, 3)), np.array([[1.0, 0.0, 1.0]]), np.eye(3)[None])
