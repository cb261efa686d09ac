"""The services of the play node: pause, resume, step, seek."""

from typing import TYPE_CHECKING

from flexslew_msgs import srv
from std_srvs.srv import Trigger

from flexslew_plant.errors import BadInput
from flexslew_plant.ros.messages import seconds_of

if TYPE_CHECKING:
    from flexslew_lab.ros.play_node import PlayNode


class PlayServices:
    """Moves a player; a tick is one of the recorded bench.

    Args:
        it: the node.
    """

    def __init__(self, it: "PlayNode") -> None:
        self._it, self._period = it, it.player.period
        node = it.node
        node.create_service(Trigger, "~/pause", self._on_pause)
        node.create_service(Trigger, "~/resume", self._on_resume)
        node.create_service(srv.Step, "~/step", self._on_step)
        node.create_service(srv.Seek, "~/seek", self._on_seek)

    def _tick(self) -> int:
        return round(self._it.player.time / self._period)

    def _on_pause(self, _: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self._it.player.pause()
        reply.success, reply.message = True, f"paused at {self._it.player.time:.3f} s"
        return reply

    def _on_resume(self, _: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self._it.player.resume()
        reply.success, reply.message = True, f"going on from {self._it.player.time:.3f} s"
        return reply

    def _on_step(self, request: srv.Step.Request, reply: srv.Step.Response) -> srv.Step.Response:
        if not self._it.player.paused:
            reply.tick, reply.message = self._tick(), "not paused; call pause first"
            return reply
        until = (self._tick() + max(1, request.ticks)) * self._period
        messages = self._it.player.step(until - 0.5 * self._period)
        self._it.send(messages)
        reply.ok, reply.tick = True, self._tick()
        reply.message = f"{len(messages)} messages, next at {self._it.player.time:.3f} s"
        return reply

    def _on_seek(self, request: srv.Seek.Request, reply: srv.Seek.Response) -> srv.Seek.Response:
        try:
            time = self._it.player.seek(seconds_of(request.time))
        except BadInput as error:
            reply.message = str(error)
            return reply
        self._it.sought()
        reply.ok, reply.message = True, f"next at {time:.3f} s"
        return reply
