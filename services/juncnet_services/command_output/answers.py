"""What command_output answers: refusals go into the health, acks to the operators."""

from juncnet.bus import Bus
from juncnet.clocks import Instant
from juncnet.messages import Ack, Override, Stamp, VelocityCommand
from juncnet.topics import COMMAND_ACK
from juncnet_services.command_output.arbiter import Arbiter, Verdict


def obey(bus: Bus, arbiter: Arbiter, commands: list[VelocityCommand], now: Instant) -> Stamp | None:
    """Offer `commands` to the arbiter; return the newest accepted one's header, if any is."""
    header = None
    for command in commands:
        reason = arbiter.command(command, now)
        if reason is None:
            header = command.header
        else:
            bus.health.error(f"velocity command refused: {reason}")
            bus.health.set(f"refused_{reason}", arbiter.refused[reason])
    return header


def acknowledge(bus: Bus, verdicts: list[tuple[Override, Verdict]], trouble: str) -> None:
    """Publish an answer to each order; `trouble`: what the operator should know besides."""
    if trouble:
        bus.health.error(trouble)
    for order, verdict in verdicts:
        reason = f"{verdict.reason}; {trouble}" if trouble else verdict.reason
        ack = Ack(
            override=order.issued,
            kind=order.kind,
            accepted=verdict.accepted,
            reason=reason,
            at=bus.stamp(),
        )
        bus.publish(COMMAND_ACK, ack)
