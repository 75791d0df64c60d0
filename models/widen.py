"""Zero-pad the weights of a small network to the thesis' width, so that the wide network computes the same function.

A padded output channel has weight 0 and bias 0: it is 0 before its normalisation. Both sizes have the same number of
channels per group, so padded channels fill whole groups, whose mean and variance are 0, and (0 − 0)/√(0 + ε)·0 + 0 = 0
after it; in a batch normalisation mean 0, variance 1, weight 0 and bias 0 do the same. A padded input channel meets
weight 0. So the first channels of every map are the small network's and the rest is 0; only the order in which a
machine adds the zeros can tell the two networks apart.

Channels are interleaved where an input is joined of several: in the point networks, which join the maps, the depth and,
in later layers, the hidden activation, and in the regressor's head, which joins the feature and the estimate. There small
columns move to where the wide network finds them.
"""
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from networks import mf_pifu, regressor, vsr

State = Mapping[str, Tensor]


def joined_columns(small: Sequence[int], wide: Sequence[int]) -> Tensor:
    """Where the channels of joined maps of widths `small` lie among the joined maps of widths `wide`."""
    starts = [sum(wide[:k]) for k in range(len(wide))]
    return torch.cat([torch.arange(width) + start for width, start in zip(small, starts)])


def padded(small: Tensor, shape: torch.Size, columns: Tensor | None = None) -> Tensor:
    """`small` in the leading corner of zeros of `shape`; its axis 1 goes to `columns` where they are given."""
    if small.dim() != len(shape) or any(s > w for s, w in zip(small.shape, shape)):
        raise ValueError(f"a tensor of shape {tuple(small.shape)} does not fit into {tuple(shape)}")
    wide = torch.zeros(shape, dtype=small.dtype)
    if columns is None:
        wide[tuple(slice(n) for n in small.shape)] = small
    else:
        wide[: small.shape[0]].index_copy_(1, columns, small)
    return wide


def mf_pifu_columns(small: mf_pifu.Size, wide: mf_pifu.Size) -> list[Tensor]:
    """For each layer of MF-PIFu's point network the places of its small input: [hidden,] map 1 .. map 4, depth."""
    maps = [s.out for s in (small, wide) for _ in range(4)]
    point_small, point_wide = [*maps[:4], 1], [*maps[4:], 1]
    columns = [joined_columns(point_small, point_wide)]
    for hidden_small, hidden_wide in zip(small.hidden, wide.hidden):
        columns.append(joined_columns([hidden_small, *point_small], [hidden_wide, *point_wide]))
    return columns


def vsr_columns(small: vsr.Size, wide: vsr.Size) -> list[Tensor | None]:
    """For each layer of VSR's point network the places of its small input; only the first joins maps."""
    return [joined_columns(small.stages, wide.stages), None, None, None]


def of_point_network(columns: Sequence[Tensor | None]) -> dict[str, Tensor]:
    """The columns of each layer of a point network under the name of the layer's weight."""
    return {f"query.mlp.layers.{k}.weight": places for k, places in enumerate(columns) if places is not None}


def widen(state: State, wide: State, columns: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The weights `state` in the shapes of `wide`, names and order of `wide`; `columns` by the weight's name."""
    if state.keys() != wide.keys():
        raise ValueError(f"the two sizes differ in {sorted(state.keys() ^ wide.keys())}")
    result = {}
    for name, target in wide.items():
        result[name] = padded(state[name], target.shape, columns.get(name))
        if name.endswith("running_var"):
            result[name][state[name].shape[0] :] = 1
    return result


def widen_mf_pifu(state: State, small: mf_pifu.Size = mf_pifu.SMALL, wide: mf_pifu.Size = mf_pifu.THESIS):
    """The state of a small MF-PIFu -> the state of a wide one that computes the same occupancy."""
    return widen(state, mf_pifu.MfPifu(wide).state_dict(), of_point_network(mf_pifu_columns(small, wide)))


def widen_vsr(state: State, small: vsr.Size = vsr.SMALL, wide: vsr.Size = vsr.THESIS):
    """The state of a small VSR -> the state of a wide one that computes the same occupancy."""
    return widen(state, vsr.Vsr(wide).state_dict(), of_point_network(vsr_columns(small, wide)))


def widen_regressor(state: State, small: regressor.Size = regressor.SMALL, wide: regressor.Size = regressor.THESIS):
    """The state of a small regressor -> the state of a wide one that answers the same on an image of any one size."""
    estimate = [regressor.POSE, regressor.BETAS, regressor.CAMERA]
    columns = joined_columns([small.features, *estimate], [wide.features, *estimate])
    return widen(state, regressor.Regressor(wide).state_dict(), {"fc1.weight": columns})
