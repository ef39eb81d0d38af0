"""The numbers that describe a hairstyle."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Style:
    """A hairstyle on any head. Lengths are metres; places on the scalp are in scalp units (1: the scalp's radius).

    Axes are the head frame's: x to the subject's left, y up, z out of the face; heights count from the scalp's centre.

    Attributes:
        seed: of everything that varies from place to place on the scalp.

        length: longest course of a strand; waves and curls make the hair itself longer.
        hem: how far below the scalp's centre the hair is cut off level. Hair too short to reach it from above ends
            in layers.
        hem_aslant: how much lower the hem is for each metre towards the subject's left.
        hem_forward: how much lower it is for each metre towards the face.
        length_noise: relative deviation of the strands' lengths.
        side_length: length of hair below ``side_height``.
        side_height: height, scalp units, below which the sides and the back are short (-2: nowhere).

        parted: how much the hair is combed sideways, away from the parting.
        parting: x of the parting, scalp units.
        sweep: how much the hair before the crown is combed backwards (negative: forwards).
        whorl: 0: combed as above; 1: all around away from the crown.
        stand: 0: combed along the scalp; 1: standing off it.
        fall: length over which combing gives way to gravity.
        stiffness: length over which a strand keeps its direction.

        lift: how strongly strands leave the scalp upwards at their roots.
        thickness: depth of the hair's body where strands have run along the head for long.
        divide: z, scalp units, beside the neck, of the line that parts hair before and behind the shoulders.
        front: slope by which the former leans forwards below the jaw.
        back: slope by which the latter leans backwards there.
        flare: slope by which all hair leans outwards.
        opening: half the width of the face that hair leaves free, scalp units.

        tied: 1 where the hair is gathered in a tail, else 0.
        tie_height: elevation of the tie, seen from the scalp's centre at the back of the head, radians.
        tie_side: how much the tie is moved to the subject's left, scalp units.
        tie_radius: radius of the bundle in the tie.
        tail_stand: how far the tail stands off before it hangs.

        fringe_width: half the fringe's width, scalp units (0: no fringe).
        fringe_depth: z from which roots belong to it, scalp units.
        fringe_hem: how far below the scalp's centre it is cut off.
        fringe_aside: how much it is combed to the subject's left.

        wave_amplitude: of waves or curls.
        wave_length: of waves or curls, along the course.
        curl: 0: waves that lie flat on the head; 1: round curls.
        wave_start: length of the straight part before waves begin.
        wave_disorder: 0: all clumps wave in step; 1: each as it will.
        clump_size: distance between clumps, scalp units.
        clumping: how far strands draw together in a clump towards its tip, from 0 to 1.
        frizz: deviation of single strands.
        flyaways: share of strands that stray farther.
    """

    seed: int = 0

    length: float = 0.5
    hem: float = 0.4
    hem_aslant: float = 0.0
    hem_forward: float = 0.0
    length_noise: float = 0.03
    side_length: float = 0.01
    side_height: float = -2.0

    parted: float = 1.0
    parting: float = 0.0
    sweep: float = 0.5
    whorl: float = 0.0
    stand: float = 0.0
    fall: float = 0.1
    stiffness: float = 0.02

    lift: float = 0.5
    thickness: float = 0.015
    divide: float = 0.0
    front: float = 0.15
    back: float = 0.15
    flare: float = 0.03
    opening: float = 0.65

    tied: float = 0.0
    tie_height: float = 0.2
    tie_side: float = 0.0
    tie_radius: float = 0.012
    tail_stand: float = 0.03

    fringe_width: float = 0.0
    fringe_depth: float = 0.45
    fringe_hem: float = 0.01
    fringe_aside: float = 0.0

    wave_amplitude: float = 0.0
    wave_length: float = 0.06
    curl: float = 0.0
    wave_start: float = 0.04
    wave_disorder: float = 0.3
    clump_size: float = 0.12
    clumping: float = 0.3
    frizz: float = 0.001
    flyaways: float = 0.02
