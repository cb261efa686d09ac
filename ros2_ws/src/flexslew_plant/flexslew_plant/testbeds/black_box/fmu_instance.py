"""An FMU for co-simulation that runs: FMI 2.0 and 3.0, by FMPy."""

import shutil
import weakref
from collections.abc import Mapping, Sequence
from io import BytesIO
from tempfile import mkdtemp
from typing import Any

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.external.messages import PlantFault
from flexslew_plant.extras import required
from flexslew_plant.near_names import spelling_hint

_REAL = ("Real", "Float64")  # types of variables, of FMI 2.0 and 3.0
_SHOWN = 12  # names of variables, in an error
_SAME = 1e-6  # of a period, by which it may miss a multiple of the FMU's own step


class FmuInstance:
    """One instance of an FMU, in a folder of its own that close() deletes.

    Args:
        name: of the file, for errors.
        content: of the file.

    Raises:
        BadInput: if it is no FMU for co-simulation with a library for this machine.
        ModuleNotFoundError: if FMPy is not installed.
    """

    def __init__(self, name: str, content: bytes) -> None:
        fmpy = required("fmpy")
        self.name, self._messages = name, list[str]()
        folder = mkdtemp(prefix="flexslew_fmu_")
        self._end = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        try:
            fmpy.extract(BytesIO(content), folder)
            # other tools' descriptions need not be valid in all parts to be flown
            description = fmpy.read_model_description(folder, validate=False)
        except Exception as error:  # FMPy, its XML parser and zipfile raise what they like
            self._end()
            raise BadInput(f"is no FMU: {_one_line(error)}", name) from None
        version = str(description.fmiVersion)[:1]
        if version not in ("2", "3") or description.coSimulation is None:
            self._end()
            words = "for model exchange alone" if version in ("2", "3") else "not of 2.0 or 3.0"
            raise BadInput(f"is {words}; export it for co-simulation, FMI 2.0 or 3.0", name)
        self.version = int(version)
        self._step = description.coSimulation.fixedInternalStepSize
        self._variables = {v.name: v for v in description.modelVariables}
        try:
            self._unit: Any = fmpy.instantiate_fmu(
                folder, description, "CoSimulation", logger=self._log
            )
        except Exception as error:  # FMPy raises Exception
            self._end()
            words = f"cannot be started on this machine: {self._cause(error)}"
            raise BadInput(words, name) from None
        self._free = weakref.finalize(self, _free, self._unit, self._end)

    def _log(self, *fields: Any) -> None:
        """Keep the last message of the FMU: instance, name, status, category, text of FMI 2.0."""
        text = fields[-1]
        self._messages[:] = [text.decode(errors="replace") if isinstance(text, bytes) else text]

    def _cause(self, error: Exception) -> str:
        """Return an error of FMPy in one line, with what the FMU has reported."""
        reported = f" ({self._messages[-1]})" if self._messages else ""
        return _one_line(error) + " ".join(reported.splitlines())

    def reference(self, variable: str, causalities: tuple[str, ...]) -> int:
        """Return the value reference of a scalar real variable.

        Args:
            variable: its name.
            causalities: the allowed ones, the usual one first.

        Raises:
            BadInput: if there is none of this name, type or causality.
        """
        found = self._variables.get(variable)
        if found is None:
            names = [v.name for v in self._variables.values() if v.causality == causalities[0]]
            few = ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")
            hint = spelling_hint(variable, self._variables)
            words = f"has no variable {variable!r}; {hint}of causality {causalities[0]}"
            raise BadInput(f"{words}: {few or 'none'}", self.name)
        if found.causality not in causalities:
            words = f"{variable} is of causality {found.causality}; {' or '.join(causalities)}"
            raise BadInput(f"{words} is needed", self.name)
        if found.type not in _REAL or found.dimensions:
            what = "an array" if found.dimensions else f"of type {found.type}"
            raise BadInput(f"{variable} is {what}; a scalar Real or Float64 is needed", self.name)
        return int(found.valueReference)

    def require_period(self, period: float) -> None:
        """Check that a communication step [s] is a multiple of the FMU's own, if it states one.

        Raises:
            BadInput: it is not.
        """
        if self._step is None:
            return
        steps = period / float(self._step)
        if abs(steps - max(round(steps), 1)) > _SAME:
            words = f"steps by {float(self._step):g} s; a period of {period:g} s is no multiple"
            raise BadInput(words, self.name)

    def unit(self, variable: str) -> str | None:
        """Return the unit that the FMU declares for a variable; None: it declares none."""
        found = self._variables[variable]
        declared = found.unit or (found.declaredType.unit if found.declaredType else None)
        return str(declared) if declared else None

    def begin(self, values: Mapping[int, float]) -> None:
        """Return to the time 0 with these values set before it.

        Raises:
            PlantFault: the FMU refuses it.
        """
        unit = self._unit
        try:
            unit.reset()
            if self.version == 2:
                unit.setupExperiment(startTime=0.0)
                self.set(list(values), list(values.values()))
                unit.enterInitializationMode()
            else:
                self.set(list(values), list(values.values()))
                unit.enterInitializationMode(startTime=0.0)
            unit.exitInitializationMode()
        except PlantFault:
            raise
        except Exception as error:  # FMICallException, OSError of a missing function
            raise PlantFault(f"{self.name}: {self._cause(error)}") from None

    def set(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Set variables.

        Raises:
            PlantFault: the FMU refuses it.
        """
        write = self._unit.setReal if self.version == 2 else self._unit.setFloat64
        try:
            if len(references):
                write(references, values)
        except Exception as error:
            raise PlantFault(f"{self.name}: {self._cause(error)}") from None

    def get(self, references: Sequence[int]) -> Vector:
        """Return the values of variables, shape (references,).

        Raises:
            PlantFault: the FMU refuses it, or one is not finite.
        """
        read = self._unit.getReal if self.version == 2 else self._unit.getFloat64
        try:
            values = np.array(read(references) if len(references) else [], dtype=np.float64)
        except Exception as error:
            raise PlantFault(f"{self.name}: {self._cause(error)}") from None
        if not np.isfinite(values).all():
            lost = references[int(np.flatnonzero(~np.isfinite(values))[0])]
            name = next(v.name for v in self._variables.values() if v.valueReference == lost)
            raise PlantFault(f"{self.name}: {name} is not finite")
        return values

    def advance(self, time: float, step: float) -> None:
        """Advance by a communication step [s] from a time [s].

        Raises:
            PlantFault: the FMU refuses it, or ends early.
        """
        try:
            done = self._unit.doStep(currentCommunicationPoint=time, communicationStepSize=step)
        except Exception as error:
            raise PlantFault(f"{self.name}: {self._cause(error)}") from None
        if isinstance(done, tuple) and (done[1] or done[2]):  # of FMI 3.0
            raise PlantFault(f"{self.name}: it ends or returns early at {time:.6g} s")

    def close(self) -> None:
        """Free it and delete its folder; a second call changes nothing."""
        self._free()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _free(unit: Any, delete: Any) -> None:
    """Free an instance in any phase, then delete its folder."""
    try:
        unit.terminate()
        unit.freeInstance()
    except Exception:  # it may have failed before; its process ends without it
        pass
    delete()
