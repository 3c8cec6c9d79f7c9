"""Materials of cells that hold several tissues: Lamé constants averaged by volume (W. Voigt).

The mean is an upper bound: exact for layers that are stretched or sheared along themselves, too stiff for layers that
are pressed across. It is taken where a layer is thinner than a cell.
"""

from collections.abc import Sequence

from mixpinn.base.errors import InputError
from mixpinn.fem.material.hyperelastic import LinearElastic, Material, StableNeoHookean, StableNeoHookeanLog


def mean_material(parts: Sequence[tuple[float, Material]]) -> Material:
    """The mean of materials by their shares, which add up to one.

    Raises:
        InputError: not built-in materials of one energy.
    """
    kinds = {type(material) for _, material in parts}
    kind = kinds.pop()
    if kinds or not issubclass(kind, StableNeoHookean | StableNeoHookeanLog | LinearElastic):
        raise InputError(
            "tissues that cells hold two of", expected="built-in materials of one energy", got="several, or another",
            fix="give all tissues the same energy, or the mixture a material of its own",
        )
    laws = [(share, material) for share, material in parts if isinstance(material, kind)]
    return kind(
        mu=sum(share * material.mu for share, material in laws),
        lam=sum(share * material.lam for share, material in laws),
    )
