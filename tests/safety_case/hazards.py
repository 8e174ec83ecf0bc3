"""Hazards of a levitated rotor, as far as target and link can bring them about or prevent them: the only declaration.

Each barrier names the tests that show it. `docs.generators.safety` makes the table of the safety case from it; a test
fails where a row has no test, or names one that is not there. A new barrier is a new row here, next to its tests.
"""

from __future__ import annotations

from dataclasses import dataclass

LINK = "tests/unit/test_target_link.py::"
PROTECTION = "tests/unit/test_target_protection.py::"
SAFETY = "tests/unit/test_target_safety.py::"
COMMANDS = "tests/unit/test_target_commands.py::"
STATES = "tests/unit/test_target_states.py::"
RECOVERY = "tests/unit/test_target_recovery.py::"
RECORD = "tests/unit/test_target_record.py::"
HOST = "tests/unit/test_target_host_loop.py::"
NO_RULE = f"{STATES}test_no_reachable_state_breaks_a_rule"


@dataclass(frozen=True)
class Barrier:
    """What stands between a cause and its effect.

    Attributes
    ----------
    hazard, cause : str
        What happens to the rotor or to people, and why.
    does : str
        What the barrier does.
    number : str
        What it is set to or was tried with. Names in braces are figures of the code, see `docs.generators.safety`.
    tests : tuple of str
        FILE::NAME of each test that shows it.
    """

    hazard: str
    cause: str
    does: str
    number: str
    tests: tuple[str, ...]


DROPPED, THROWN, POWERED, LOST = (
    "Rotor is dropped", "Rotor hits its backup bearing under power", "Power where nobody expects it",
    "Nobody can land it",
)  # fmt: skip

BARRIERS = (
    Barrier(THROWN, "wrong sign, lost stability",
            "displacement trips: settled, and before that by contact and lift time",
            "{limits.trip_share:g} of the clearance; before that {limits.contact_share:g}, or {limits.lift_time:g} s",
            (f"{SAFETY}test_displacement_beyond_the_contact_trips_while_levitating_and_landing",
             f"{SAFETY}test_a_rotor_that_does_not_lift_off_is_given_up_before_the_ramp_ends", NO_RULE)),
    Barrier(THROWN, "sensor fails: no signal, out of range", "trips in the same step; NaN counts as out of range",
            "{limits.sensor_range:g} m",
            (f"{PROTECTION}test_a_position_trips_at_its_step_and_switches_off_in_it", NO_RULE)),
    Barrier(THROWN, "sensor is stuck", "trips if a position stays the same bit for bit", "{limits.stuck_time:g} s",
            (f"{PROTECTION}test_a_sensor_that_does_not_move_trips_after_its_time",
             f"{SAFETY}test_a_sensor_that_is_stuck_is_found_on_the_ramps_too", NO_RULE)),
    Barrier(THROWN, "levitation from beyond the bearing", "LEVITATE is refused",
            "{limits.contact_share:g} of the clearance",
            (f"{SAFETY}test_a_rotor_beyond_its_clearance_is_not_levitated",)),
    Barrier(THROWN, "excitation or reference too large", "sum checked radially, at arming and at every change",
            "alarm share {limits.alarm_share:g}, trip share {limits.trip_share:g}",
            (f"{SAFETY}test_the_sum_of_reference_and_excitation_is_checked_at_arming_and_at_every_change",
             f"{SAFETY}test_the_nominal_reference_is_checked_radially")),
    Barrier(THROWN, "reference jumps", "slew limit of reference and excitation; an excitation that ends fades",
            "{sequences} random sequences a test run, 0 jumps",
            ("tests/unit/test_target_sequences.py::test_no_sequence_makes_the_reference_jump_or_breaks_a_limit",
             f"{PROTECTION}test_an_excitation_that_ends_early_never_jumps",
             f"{SAFETY}test_a_fade_ends_within_a_minute_however_low_the_slew")),
    Barrier(THROWN, "fault in wiring, sensor or amplifier that was there before the first lift",
            "commissioning names it with small currents", "{kinds} kinds of fault planted",
            ("tests/unit/test_commissioning_faults.py::test_a_planted_fault_is_named_and_nothing_else_without_a_touch",)),
    Barrier(DROPPED, "a host connects, or changes gains", "connecting moves nothing; changes are ramped or refused",
            "gains between half and twice, in {limits.settle_time:g} s",
            (f"{RECOVERY}test_a_host_that_connects_to_a_levitated_rotor_does_not_move_it",
             f"{SAFETY}test_gains_that_would_drop_a_levitated_rotor_are_refused",
             f"{SAFETY}test_gains_change_little_by_little",
             f"{SAFETY}test_limits_that_would_drop_a_levitated_rotor_are_refused")),
    Barrier(DROPPED, "host dies", "the loop is on the target and stays closed; the excitation fades",
            "host time {limits.host_time:g} s; lands after the land time, {limits.land_time:g} s unless configured",
            (f"{PROTECTION}test_a_silent_host_ends_the_excitation_and_not_the_loop",
             f"{PROTECTION}test_a_machine_lands_if_its_host_is_gone_for_the_configured_time")),
    Barrier(DROPPED, "currents of a host that closes the loop are late", "trips, or the PD law lands",
            "{limits.missed_steps:g} missed",
            (f"{HOST}test_without_currents_for_too_long_it_switches_off",
             f"{HOST}test_or_the_pd_law_lands_it_with_the_current_that_a_pd_of_the_host_would_have_sent")),
    Barrier(DROPPED, "forged, replayed or reordered command", "seal, session and counter",
            "{states[hostile]} hostile frames in {states[states]} states, 0 effects",
            (f"{COMMANDS}test_0_of_many_forged_commands_are_taken",
             f"{COMMANDS}test_commands_of_before_a_reboot_are_not_taken",
             "tests/fuzz/test_target.py::test_no_datagram_harms_the_target_and_none_is_accepted_that_is_forged",
             NO_RULE)),
    Barrier(POWERED, "trip is not seen, or reset without a look",
            "latched until FAULT_RESET; then a new measurement first",
            "{states[transitions]} transitions, 0 wrong",
            (f"{PROTECTION}test_a_trip_stays_until_a_reset_and_refuses_levitation",
             f"{SAFETY}test_resets_do_not_count_one_measurement_again", NO_RULE,
             f"{STATES}test_only_levitate_powers_and_only_a_reset_leaves_a_trip")),
    Barrier(POWERED, "reset and lift again after a loss of control", "lock after a trip by displacement",
            "{limits.lock_time:g} s",
            (f"{SAFETY}test_after_a_trip_by_displacement_faults_are_not_reset_at_once", NO_RULE)),
    Barrier(POWERED, "off is asked for in an unexpected state", "DELEVITATE 0 acts at once in every state",
            "{states[states]} states, 0 exceptions", (f"{SAFETY}test_off_acts_at_once_in_every_state", NO_RULE)),
    Barrier(POWERED, "current path keeps its current", "an enable of its own, off in the step of a trip", "1 step",
            (f"{SAFETY}test_a_trip_switches_the_hardware_enable_off_in_its_step", NO_RULE)),
    Barrier(POWERED, "over-current, heat, saturation, amplifiers", "trips",
            "{limits.coil_current:g} A for {limits.coil_time:g} s; {limits.temperature:g} deg C; "
            "{limits.saturation_time:g} s at the limit",
            (f"{PROTECTION}test_over_current_trips_only_if_it_lasts", f"{PROTECTION}test_other_inputs_trip",
             f"{SAFETY}test_a_current_at_its_limit_is_not_kept_there", NO_RULE)),
    Barrier(POWERED, "control steps are missed", "watchdog with a rate",
            "{limits.missed_steps:g} steps; adds up from a share of {limits.missed_share:g}",
            (f"{SAFETY}test_the_watchdog_counts_the_rate_of_misses", NO_RULE)),
    Barrier(POWERED, "configuration that makes no sense", "the target does not start", "0 started",
            ("tests/unit/test_target_init.py::test_it_does_not_start",)),
    Barrier(LOST, "attacker on the path; counter lost; target started anew", "sealed description with a challenge",
            "commands again within 1 s; from all {states[recovered]} states levitated again",
            (f"{RECOVERY}test_a_host_under_attack_commands_again_within_a_second",
             f"{STATES}test_the_host_levitates_the_rotor_again_from_every_state")),
    Barrier(LOST, "wrong counter of a host with the key", "a counter far ahead of the last is dropped",
            "2^32 ahead",
            (f"{RECORD}test_the_largest_counter_does_not_make_a_target_deaf",)),
    Barrier(LOST, "reply is lost", "the same frame again is answered, and done once", "{states[repeated]} repetitions",
            (f"{COMMANDS}test_the_same_frame_again_is_answered_and_done_once", NO_RULE)),
    Barrier(LOST, "background keeps the control step out", "locks of a bounded number of instructions",
            "at most 8000 instructions",
            ("tests/unit/test_target_threads.py::"
             "test_the_background_keeps_the_interrupt_out_for_a_bounded_number_of_instructions",
             "tests/unit/test_target_threads.py::test_nothing_is_shared_without_the_lock")),
    Barrier(LOST, "port that differs from the protocol", "`amb rig check`", "{planted} faults planted in ports",
            ("tests/unit/test_conformance.py::test_a_planted_fault_is_named",)),
)  # fmt: skip
