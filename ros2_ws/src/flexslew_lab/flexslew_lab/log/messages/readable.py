"""Whether a message that a log is read with would be read back."""

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages import cdr
from flexslew_lab.log.messages.logged_event import logged_event
from flexslew_lab.log.messages.record_schema import RECORDS, check_record
from flexslew_plant.errors import BadInput


def can_read(topic: str, data: bytes) -> bool:
    """Return whether a reader takes an event or a message of a latched topic; True of all others.

    Args:
        topic: absolute name.
        data: CDR.
    """
    try:
        if topic == "/events":
            logged_event(cdr.decode(TOPICS[topic].type, data), topic)
        elif topic in RECORDS:
            check_record(topic, cdr.decode(TOPICS[topic].type, data), topic)
    except BadInput:
        return False
    return True
