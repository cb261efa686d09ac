"""What the import of a finite element model prints, draws and writes.

Offers: modal_output, page, tables.
"""
