"""The parts of the plant node: settings, parameters, services, report, display and diagnostics."""
