"""The services of the play node: pause, resume, step, seek."""

from collections.abc import Callable, Sequence

from flexslew_msgs import srv
from rclpy.node import Node
from std_srvs.srv import Trigger

from flexslew_lab.replay.player import Outgoing, Player
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.messages import seconds_of
from flexslew_plant.ros.offers import service


class PlayServices:
    """Moves a player; a tick is one of the recorded bench.

    Args:
        node: that offers them.
        player: that is moved.
        send: publishes messages.
        after_seek: called when the player has gone to another place.
    """

    def __init__(
        self,
        node: Node,
        player: Player,
        send: Callable[[Sequence[Outgoing]], None],
        after_seek: Callable[[], None],
    ) -> None:
        self._player, self._send, self._after_seek = player, send, after_seek
        service(node, Trigger, "~/pause", self._on_pause)
        service(node, Trigger, "~/resume", self._on_resume)
        service(node, srv.Step, "~/step", self._on_step)
        service(node, srv.Seek, "~/seek", self._on_seek)

    def _tick(self) -> int:
        return round(self._player.time / self._player.period)

    def _on_pause(self, _: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self._player.pause()
        reply.success, reply.message = True, f"paused at {self._player.time:.3f} s"
        return reply

    def _on_resume(self, _: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self._player.resume()
        reply.success, reply.message = True, f"going on from {self._player.time:.3f} s"
        return reply

    def _on_step(self, request: srv.Step.Request, reply: srv.Step.Response) -> srv.Step.Response:
        if not self._player.paused:
            reply.tick, reply.message = self._tick(), "not paused; call pause first"
            return reply
        until = (self._tick() + max(1, request.ticks)) * self._player.period
        messages = self._player.step(until - 0.5 * self._player.period)
        self._send(messages)
        reply.ok, reply.tick = True, self._tick()
        reply.message = f"{len(messages)} messages, next at {self._player.time:.3f} s"
        return reply

    def _on_seek(self, request: srv.Seek.Request, reply: srv.Seek.Response) -> srv.Seek.Response:
        try:
            time = self._player.seek(seconds_of(request.time))
        except BadInput as error:
            reply.message = str(error)
            return reply
        self._after_seek()
        reply.ok, reply.message = True, f"next at {time:.3f} s"
        return reply
