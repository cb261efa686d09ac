"""Direct lines: question and answer between processes of one machine, past DDS.

The plant listens on a UNIX socket with a name that follows from the bench; a controller of the
same user that finds it receives its questions there, in the bytes that go over DDS. In the same way
the recorder takes the copies. A socket needs no shared memory, leaves nothing behind when its
process is killed, and closes the other end at once.

Offers: inbox, line, lines, names.
"""
