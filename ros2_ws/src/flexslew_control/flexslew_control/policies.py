"""Prints the SROS 2 policies of a bench with the shipped laws."""

from flexslew_control.controllers import CONTROLLERS
from flexslew_plant.graph.policies import policies

if __name__ == "__main__":
    print(policies(CONTROLLERS), end="")
