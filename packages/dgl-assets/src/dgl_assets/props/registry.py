"""Props by kind or by their parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dgl_assets.props.hanger import (
    CoatHangerParameters,
    HangerParameters,
    make_coat_hanger,
    make_hanger,
)
from dgl_assets.props.person import PersonParameters, make_person_prop
from dgl_assets.props.prop import Prop
from dgl_assets.props.stands import (
    GloveStandParameters,
    HatStandParameters,
    PothookParameters,
    make_glove_stand,
    make_hat_stand,
    make_pothook,
)
from dgl_assets.props.tables import (
    PlatformParameters,
    TableParameters,
    make_platform,
    make_table,
)

PropParameters = (
    HangerParameters
    | CoatHangerParameters
    | PothookParameters
    | PlatformParameters
    | HatStandParameters
    | GloveStandParameters
    | TableParameters
    | PersonParameters
)
"""Parameters of any kind of prop."""
_MAKERS: dict[str, tuple[type[Any], Callable[[Any], Prop]]] = {
    "hanger": (HangerParameters, make_hanger),
    "coat_hanger": (CoatHangerParameters, make_coat_hanger),
    "pothook": (PothookParameters, make_pothook),
    "platform": (PlatformParameters, make_platform),
    "hat_stand": (HatStandParameters, make_hat_stand),
    "glove_stand": (GloveStandParameters, make_glove_stand),
    "table": (TableParameters, make_table),
    "person": (PersonParameters, make_person_prop),
}
PROP_KINDS: tuple[str, ...] = tuple(_MAKERS)
"""Names of all kinds."""


def make_prop(what: str | PropParameters) -> Prop:
    """Make a prop of its default measures by its kind, or of your own by its parameters.

    Raises:
        ValueError: Naming the kinds there are.
    """
    for kind, (parameters, make) in _MAKERS.items():
        if what == kind:
            return make(parameters())
        if isinstance(what, parameters):
            return make(what)
    raise ValueError(f"prop must be one of {list(PROP_KINDS)} or their parameters; got {what!r}")
