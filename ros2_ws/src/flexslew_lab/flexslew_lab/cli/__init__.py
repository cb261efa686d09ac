"""The command line.

Offers: terminal.
"""

import os
import sys

# only where this is the program: an interrupted import would end in a traceback
if "flexslew_lab.cli.main" in sys.orig_argv or os.path.basename(sys.argv[0]) == "flexslew":
    from flexslew_lab.cli.interrupt import set_import_handler

    set_import_handler()
    from flexslew_lab.cli.early import join

    join(sys.argv[1:])
