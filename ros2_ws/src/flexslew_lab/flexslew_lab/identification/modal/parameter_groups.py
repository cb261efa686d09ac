"""Outputs of a record in groups that share residues."""

from dataclasses import dataclass

from flexslew_lab.identification.records.record import Quantity, Record


@dataclass(frozen=True)
class ParameterGroup:
    """Outputs that share residues: a joint's position and rate, or one output alone.

    Args:
        position: column of the record with a displacement; -1: not measured.
        rate: column with its rate; -1: not measured.
        rigid: whether the rigid motion is part of it.
        acceleration: column with an acceleration, alone; -1: none.
    """

    position: int
    rate: int
    rigid: bool
    acceleration: int = -1

    @property
    def columns(self) -> tuple[tuple[int, int], ...]:
        """Columns of the record with their orders of derivative, 0 to 2."""
        found = enumerate((self.position, self.rate, self.acceleration))
        return tuple((column, order) for order, column in found if column >= 0)


def groups_of(record: Record) -> tuple[ParameterGroup, ...]:
    """Return the outputs of a record in groups of one set of residues each.

    Joints with a position come first, then deflections, then what has no displacement.
    """
    found = []
    rates = {o.joint: k for k, o in enumerate(record.outputs) if o.quantity is Quantity.JOINT_RATE}
    for k, o in enumerate(record.outputs):
        if o.quantity is Quantity.JOINT_POSITION:
            found.append(ParameterGroup(k, rates.pop(o.joint, -1), True))
    found += [ParameterGroup(k, -1, False) for k in record.columns(Quantity.DEFLECTION)]
    found += [ParameterGroup(-1, k, True) for k in rates.values()]
    found += [ParameterGroup(-1, k, False) for k in record.columns(Quantity.DEFLECTION_RATE)]
    found += [ParameterGroup(-1, -1, True, k) for k in record.columns(Quantity.ACCELERATION)]
    return tuple(found)


def bias_columns(group: ParameterGroup) -> int:
    """Return how many columns of a group stand before its rigid ones: line and bias."""
    if group.position < 0:
        return 1
    return 3 if group.rate >= 0 else 2
