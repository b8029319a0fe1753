"""Draws how a robot's servos are wired to their board, from its description.

python docs/draw_wiring.py                                 # docs/images/wiring.svg
python docs/draw_wiring.py --robot my-robot.toml --out my-wiring.svg
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from draw_robot import INK, PALE, SHADE, Point, View, colour_of, main, svg

from ccr_host.description.schema import Description

PICTURE = Path(__file__).parent / "images" / "wiring.svg"
LIVE = "#c0392b"
"""Colour of the servos' supply."""
SERVO_A, LEAST_A = 2.5, 5.0
"""A stalled servo, and the supply of two."""
ROW = 64.0
"""Pixels between two servos, as all lengths here."""
SMALL = 11
BOARD, SERVOS, POSITIVE, NEGATIVE, TOP = (330.0, 460.0), (640.0, 720.0), 800.0, 830.0, 60.0
"""Left and right edges of the boxes, the two rails, and the row of the supply."""
FIRST = 300.0
"""Row of the first servo."""


@dataclass(frozen=True)
class BoardPins:
    """A board of the firmware (firmware/boards)."""

    name: str
    servos: tuple[int, ...]
    supply: int
    emergency_stop: int


BOARDS = {
    "uno": BoardPins("Arduino UNO", (9, 10), 8, 7),
    "mega2560": BoardPins("Arduino Mega 2560", (11, 5, 6, 46, 12, 2, 7, 45, 3, 8, 44, 13), 22, 23),
}


def board_of(motors: int) -> BoardPins:
    """The smallest board that drives so many motors."""
    return next(board for board in BOARDS.values() if len(board.servos) >= motors)


def wiring_svg(description: Description) -> str:
    """The drawing as SVG text."""
    motors = description.robot.motors
    board = board_of(motors)
    servos = f"{motors} servo{'s' * (motors > 1)} (leads: red +, brown -, orange signal)"
    title = f"{board.name} and {servos}; pale: optional"
    view = View(title, (0, 0), (POSITIVE / 2 + 60, 24), scale=(1, -1))
    last = FIRST + ROW * (max(motors, 3) - 1)
    _box(view, (BOARD[0], FIRST - 65), (BOARD[1], last + 45), board.name)
    _supply(view, motors)
    for motor in range(motors):
        _servo(view, description, board, motor)
    end = FIRST + ROW * (motors - 1)
    view.line((POSITIVE, TOP), (POSITIVE, end - 10), colour=LIVE, width=2)
    view.line((NEGATIVE, TOP + 70), (NEGATIVE, end + 10), width=2)
    _beside_the_board(view, board)
    return svg([view], 1100, last + 70)


def _supply(view: View, motors: int) -> None:
    """Draw the wires from the supply to the rails, and the one ground."""
    needed_a = max(LEAST_A, SERVO_A * motors)
    bottom = TOP + 70
    _box(view, (20, TOP - 22), (130, bottom + 22), "")
    view.text((75, TOP + 22), "6 V supply")
    view.text((75, TOP + 40), f"{needed_a:g} A or more,", size=SMALL)
    view.text((75, TOP + 54), "current-limited", size=SMALL)
    view.text((120, TOP + 5), "+", LIVE, "end", 16)
    view.text((120, bottom + 5), "-", INK, "end", 16)
    view.line((130, TOP), (POSITIVE, TOP), colour=LIVE, width=2)
    view.line((130, bottom), (NEGATIVE, bottom), width=2)
    _part(view, (200, TOP), f"fuse {needed_a:g} A", colour=LIVE)
    _switch(view, (300, TOP), "emergency stop", LIVE)
    _box(view, (425, TOP - 18), (535, TOP + 18), f"switch, {needed_a:g} A", PALE)
    _capacitor(view, (690, TOP), bottom)
    ground = BOARD[1] - 30
    view.line((ground, FIRST - 65), (ground, FIRST - 100), (690, FIRST - 100), (690, bottom))
    view.text((ground - 4, FIRST - 48), "GND", size=SMALL)
    view.text((575, FIRST - 106), "one connection", size=SMALL)
    _dot(view, (690, bottom))


def _servo(view: View, description: Description, board: BoardPins, motor: int) -> None:
    robot, colour, y = description.robot, colour_of(motor), FIRST + ROW * motor
    view.text((BOARD[1] - 6, y + 5), str(board.servos[motor]), anchor="end")
    view.line((BOARD[1], y), (SERVOS[0], y), colour=colour, width=2)
    _part(view, (510, y), "330", colour=colour)
    _dot(view, (575, y), colour)
    view.line((575, y), (575, y + 34))
    _part(view, (575, y + 19), "10 k", down=True)
    _ground(view, (575, y + 34))
    _box(view, (SERVOS[0], y - 20), (SERVOS[1], y + 20), f"servo {motor + 1}", colour)
    view.line((SERVOS[1], y - 10), (POSITIVE, y - 10), colour=LIVE, width=2)
    view.line((SERVOS[1], y + 10), (NEGATIVE, y + 10), width=2)
    _dot(view, (POSITIVE, y - 10), LIVE)
    _dot(view, (NEGATIVE, y + 10))
    if robot.motors > len(BOARDS["uno"].servos):
        _part(view, (760, y - 10), "3 A", colour=LIVE)
    wound = [
        (segment + 1, number)
        for number, (segment, tendon) in enumerate(robot.tendons, start=1)
        if tendon.motor == motor + 1
    ]
    segments = _listed("segment", sorted({segment for segment, _ in wound}))
    tendons = _listed("tendon", [number for _, number in wound])
    view.text((NEGATIVE + 20, y + 5), f"{segments}, {tendons}", colour, "start")


def _beside_the_board(view: View, board: BoardPins) -> None:
    """What may be wired besides: supply switch, emergency-stop contact, divider; and USB."""
    left, switch = BOARD[0], (BOARD[0] + 40, FIRST - 65)
    view.line(switch, (switch[0], FIRST - 130), (480, FIRST - 130), (480, TOP + 18), colour=PALE)
    view.text((switch[0], FIRST - 48), str(board.supply), size=SMALL)
    _dot(view, (switch[0], FIRST - 100), PALE)
    view.line((switch[0], FIRST - 100), (switch[0] - 60, FIRST - 100), colour=PALE)
    _part(view, (switch[0] - 30, FIRST - 100), "10 k")
    _ground(view, (switch[0] - 60, FIRST - 100))

    stop = FIRST - 20
    view.text((left + 6, stop + 5), str(board.emergency_stop), anchor="start")
    view.line((left, stop), (110, stop), colour=PALE)
    _switch(view, (200, stop), "emergency stop, 2nd contact", PALE)
    _ground(view, (110, stop))

    divider, node = FIRST + 35, 240.0
    view.text((left + 6, divider + 5), "A0", anchor="start")
    view.line((left, divider), (110, divider), colour=PALE)
    _part(view, (175, divider), "10 k")
    _ground(view, (110, divider))
    _dot(view, (node, divider), PALE)
    view.line((node, divider), (node, divider + 50), colour=PALE)
    _part(view, (node, divider + 25), "10 k", down=True)
    view.text((node - 8, divider + 54), "servos' +", LIVE, "end", SMALL)

    usb = FIRST + 130
    view.text((left + 6, usb + 5), "USB", anchor="start")
    view.line((left, usb), (190, usb), width=4)
    view.text((184, usb + 5), "host", anchor="end")


def _box(view: View, corner: Point, opposite: Point, words: str, colour: str = INK) -> None:
    (left, top), (right, bottom) = corner, opposite
    around = (corner, (right, top), opposite, (left, bottom), corner)
    view.line(*around, colour=colour, fill=SHADE if colour == INK else "white")
    middle = (top + bottom) / 2 + 4 if bottom - top < ROW else bottom - 10
    view.text(((left + right) / 2, middle), words, size=12)


def _part(view: View, at: Point, words: str, colour: str = INK, *, down: bool = False) -> None:
    """A resistor or a fuse on a line."""
    half = (5.0, 10.0) if down else (15.0, 6.0)
    _box(view, (at[0] - half[0], at[1] - half[1]), (at[0] + half[0], at[1] + half[1]), "")
    beside = (at[0] + 9, at[1] + 4) if down else (at[0], at[1] - 10)
    view.text(beside, words, colour, "start" if down else "middle", SMALL)


def _switch(view: View, at: Point, words: str, colour: str) -> None:
    """A contact that is closed unless it is pressed."""
    x, y = at
    view.line((x - 18, y), (x + 18, y), colour="white", width=4)
    view.line((x - 18, y), (x + 20, y + 5), colour=colour, width=2)
    view.line((x + 18, y), (x + 18, y + 8), colour=colour, width=2)
    for end in (x - 18, x + 18):
        _dot(view, (end, y), colour)
    view.text((x, y - 10), words, size=SMALL)


def _capacitor(view: View, at: Point, bottom: float) -> None:
    x, top = at
    middle = (top + bottom) / 2
    for start, end, sign in ((top, middle - 4, -1), (bottom, middle + 4, 1)):
        view.line((x, start), (x, end))
        view.line((x - 12, middle + 4 * sign), (x + 12, middle + 4 * sign), width=2.5)
        _dot(view, (x, start))
    view.text((x - 16, middle + 4), "1000 uF, 10 V", INK, "end", SMALL)
    view.text((x + 8, middle - 8), "+", INK, "start", SMALL)


def _ground(view: View, at: Point) -> None:
    x, y = at
    view.line((x, y), (x, y + 6))
    for below, half in enumerate((7.0, 4.5, 2.0)):
        view.line((x - half, y + 6 + 3 * below), (x + half, y + 6 + 3 * below), width=1.5)


def _dot(view: View, at: Point, colour: str = INK) -> None:
    view.circle(at, 2.5, colour, colour)


def _listed(word: str, numbers: list[int]) -> str:
    texts = ", ".join(map(str, numbers))
    return f"{word}{'s' * (len(numbers) > 1)} {texts}"


if __name__ == "__main__":
    main(wiring_svg, __doc__, PICTURE)
