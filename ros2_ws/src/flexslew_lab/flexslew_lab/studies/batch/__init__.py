"""Many trials at once by one compiled kernel, checked by the ordinary bench.

From `fleet` through `legs` to the compiled `loop`; `groups` says what flies together, `laws` and
`benches` are what the loop is made of, `check` flies some of it again.
"""
