"""The CSA two-motor testbed: its settings, its equations, and many trials of it at once."""

from flexslew_plant.testbeds.csa.testbed import CsaInitial as CsaInitial
from flexslew_plant.testbeds.csa.testbed import CsaParameters as CsaParameters
from flexslew_plant.testbeds.csa.testbed import CsaTestbed as CsaTestbed
from flexslew_plant.testbeds.csa.testbed import CsaVariant as CsaVariant
from flexslew_plant.testbeds.csa.testbed import beam as beam
