"""Copies of a plant move on their own, from the same state."""

import copy
import pickle
from collections.abc import Callable

import pytest

from amb_core.plant import Plant


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda plant: pickle.loads(pickle.dumps(plant))])
def test_a_copy_moves_as_the_original_and_leaves_it_alone(copied: Callable[[Plant], Plant]) -> None:
    plant = Plant()
    plant.advance((0.1, 0.2))
    other = copied(plant)
    before = plant.position
    moved = other.advance((1.0, 1.0))
    assert plant.position == before
    assert plant.advance((1.0, 1.0)) == moved
