"""Outputs of a record in groups that share residues."""

from dataclasses import dataclass

from flexslew_lab.identification.record import Quantity, Record


@dataclass(frozen=True)
class ParameterGroup:
    """Outputs that share residues: a joint's position and rate, or one deflection."""

    position: int  # column of the record; -1: not measured
    rate: int  # the same
    rigid: bool


def groups_of(record: Record) -> tuple[ParameterGroup, ...]:
    """Return the outputs of a record in groups of one set of residues each."""
    found = []
    rates = {o.joint: k for k, o in enumerate(record.outputs) if o.quantity is Quantity.JOINT_RATE}
    for k, o in enumerate(record.outputs):
        if o.quantity is Quantity.JOINT_POSITION:
            found.append(ParameterGroup(k, rates.pop(o.joint, -1), True))
    found += [ParameterGroup(-1, k, True) for k in rates.values()]
    found += [ParameterGroup(k, -1, False) for k in record.columns(Quantity.DEFLECTION)]
    found += [ParameterGroup(-1, k, False) for k in record.columns(Quantity.DEFLECTION_RATE)]
    return tuple(found)


def bias_columns(group: ParameterGroup) -> int:
    """Return how many columns of a group stand before its rigid ones: line and bias."""
    if group.position < 0:
        return 1
    return 3 if group.rate >= 0 else 2
