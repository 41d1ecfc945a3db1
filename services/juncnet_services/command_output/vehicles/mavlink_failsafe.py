"""What an autopilot does when our link is lost, read from its parameters: pure.

A robot must not fly on when nobody steers it. Autopilots differ, and their usual settings for
flying without a remote control do fly on: PX4 v1.17 with COM_RC_IN_MODE 4 and NAV_RCL_ACT 0 went on
at 1.4 m/s for 6 s after the setpoints had ended; with COM_OBL_RC_ACT 5 it held within 1.2 s.
"""

from collections.abc import Mapping
from typing import Literal

from juncnet_services.command_output.vehicles.mavlink_wire import Autopilot

Kind = Literal["copter", "rover"]
PX4_ACTIONS = {
    0: "Position mode",
    1: "Altitude mode",
    2: "Manual",
    3: "Return",
    4: "Land",
    5: "Hold",
    6: "Terminate",
    7: "Disarm",
}
ROVER_WITHOUT_SETPOINTS_S = 3.0
"""ArduPilot Rover stops by itself then; there is no parameter for it."""


def needed(autopilot: Autopilot, kind: Kind) -> tuple[str, ...]:
    """Return the parameters that `findings` judges."""
    if autopilot is Autopilot.PX4:
        return ("COM_OBL_RC_ACT", "COM_OF_LOSS_T", "COM_RC_IN_MODE", "NAV_RCL_ACT")
    if kind == "copter":
        return ("GUID_TIMEOUT", "FS_GCS_ENABLE")
    return ("FS_ACTION", "FS_GCS_ENABLE", "FS_TIMEOUT")


def optional(autopilot: Autopilot, kind: Kind) -> tuple[str, ...]:
    """Return the parameters that are used where there are any."""
    return ("RO_YAW_P",) if autopilot is Autopilot.PX4 and kind == "rover" else ()


def findings(
    autopilot: Autopilot, kind: Kind, values: Mapping[str, float], longest_s: float
) -> list[str]:
    """Return why a lost link would let the robot go on, each with its remedy; none: it may fly.

    Args:
        autopilot: whose parameters they are.
        kind: of vehicle.
        values: parameters by name, those of `needed` as far as they could be read.
        longest_s: for how long the robot may go on after the last setpoint.
    """
    missing = [name for name in needed(autopilot, kind) if name not in values]
    if missing:
        return [f"{', '.join(missing)} could not be read: check the link, restart the autopilot"]
    if autopilot is Autopilot.PX4:
        return _px4(values, longest_s)
    if kind == "copter":
        return _ardupilot_copter(values, longest_s)
    return _ardupilot_rover(values, longest_s)


def _px4(values: Mapping[str, float], longest_s: float) -> list[str]:
    found: list[str] = []
    action = int(values["COM_OBL_RC_ACT"])
    sticks = values["COM_RC_IN_MODE"] != 4
    rc_lost = int(values["NAV_RCL_ACT"])
    by_hand = action == 0 and sticks and rc_lost in (1, 3)
    if action not in (4, 5) and not by_hand:
        why = (
            f"without setpoints it goes to {PX4_ACTIONS.get(action, '?')} (COM_OBL_RC_ACT {action})"
        )
        if action in (0, 1, 2):
            why += f", COM_RC_IN_MODE {values['COM_RC_IN_MODE']:g}, NAV_RCL_ACT {rc_lost}"
        found.append(f"{why}: set COM_OBL_RC_ACT to 5 (Hold) or 4 (Land)")
    if values["COM_OF_LOSS_T"] > longest_s:
        loss_s = values["COM_OF_LOSS_T"]
        found.append(
            f"it goes on for {loss_s:g} s without setpoints: set COM_OF_LOSS_T to {longest_s:g}"
        )
    return found


def _ardupilot_copter(values: Mapping[str, float], longest_s: float) -> list[str]:
    timeout_s = values["GUID_TIMEOUT"]
    if timeout_s <= longest_s:
        return []
    return [f"it goes on for {timeout_s:g} s without setpoints: set GUID_TIMEOUT to {longest_s:g}"]


def _ardupilot_rover(values: Mapping[str, float], longest_s: float) -> list[str]:
    enabled, action = values["FS_GCS_ENABLE"] == 1, int(values["FS_ACTION"])
    stops = enabled and action in (2, 6)
    after_s = values["FS_TIMEOUT"] if stops else ROVER_WITHOUT_SETPOINTS_S
    if after_s <= longest_s:
        return []
    return [
        f"it goes on for {after_s:g} s without setpoints (FS_GCS_ENABLE "
        f"{values['FS_GCS_ENABLE']:g}, FS_ACTION {action}, FS_TIMEOUT {values['FS_TIMEOUT']:g}): "
        f"set FS_GCS_ENABLE to 1, FS_ACTION to 2 (Hold) and FS_TIMEOUT to {longest_s:g}"
    ]
