"""Draw the power schematic of the build document: `python docs/power_schematic.py` writes the SVG.

Needs `pip install 'wheelchair_gym[docs]'` (schemdraw).
"""

from pathlib import Path

import schemdraw
from schemdraw import elements as elm

OUTPUT = Path(__file__).parent / "images" / "power.svg"
BUS = 8.6  # height of the positive bus; the negative one is at 0


def _pack(drawing: schemdraw.Drawing, x: float, number: int) -> None:
    """One battery pack and its fuse, between the buses."""
    drawing.add(elm.Line().at((x, 0)).up(1.2))
    drawing.add(
        elm.Battery().up(2.4).reverse().label(f"pack {number}\n36 V 4 Ah\nwith BMS", loc="top")
    )
    drawing.add(elm.Fuse().up(1.8).label(f"F{number}\n20 A", loc="bottom"))
    drawing.add(elm.Line().toy(BUS))


def _coil(drawing: schemdraw.Drawing, label: str) -> elm.Element:
    """A coil, downwards, with a diode and a zener diode across it."""
    coil = drawing.add(elm.Inductor2().down(2.0).label(label, loc="top", ofst=0.2))
    drawing.add(elm.Line().at(coil.start).right(0.9))
    drawing.add(elm.Zener().down(1.0))
    drawing.add(elm.Diode().down(1.0).reverse())
    drawing.add(elm.Line().left(0.9))
    drawing.move_from(coil.end)
    return coil


def _driver(drawing: schemdraw.Drawing, x: float, side: str) -> None:
    """One motor driver with its motor."""
    drawing.add(elm.Line().at((x, BUS)).down(1.2))
    box = elm.Ic(
        size=(2.6, 1.6),
        pins=[elm.IcPin(side="top", pin=""), elm.IcPin(side="bottom", pin="")],
        label=f"{side} driver\n12 A limit",
    )
    placed = drawing.add(box.at((x, BUS - 1.2)).anchor("inT1").theta(0))
    drawing.add(elm.Switch().at(placed.inB1).down(1.2).label("K2", loc="top"))
    motor = drawing.add(elm.Motor().down(2.0).label(f"{side}\nmotor", loc="top"))
    drawing.add(elm.Line().toy(0))
    drawing.add(elm.Line().at(motor.start).right(1.2))
    drawing.add(elm.Switch(nc=True).down(1.0).label("K2", loc="bottom"))
    drawing.add(elm.Button(nc=True).down(1.0).label("S6 push", loc="bottom"))
    drawing.add(elm.Line().left(1.2))


def _coil_of_board(drawing: schemdraw.Drawing, x: float, name: str, pin: str) -> None:
    """A coil that the drive board switches, with its fuse and its transistor."""
    drawing.add(elm.Fuse().at((x, BUS)).down(1.6).label("1 A", loc="bottom"))
    coil = _coil(drawing, name)
    fet = drawing.add(elm.NFet().at(coil.end).anchor("drain").theta(0))
    drawing.add(elm.Line().at(fet.source).toy(0))
    drawing.add(elm.Resistor().at(fet.gate).down(1.4).label("10 kΩ", loc="bottom"))
    drawing.add(elm.Line().toy(0))
    drawing.add(elm.Resistor().at(fet.gate).right(1.2).label("100 Ω").label(pin, loc="right"))


def draw() -> None:
    """Write the schematic as SVG."""
    with schemdraw.Drawing(file=str(OUTPUT), show=False) as drawing:
        drawing.config(fontsize=10, unit=2)
        _pack(drawing, 0, 1)
        _pack(drawing, 3, 2)
        drawing.add(elm.Line().at((0, BUS)).right(4.2))
        drawing.add(elm.Switch().right(1.8).label("S1\nmain switch"))
        drawing.add(elm.Fuse().right(1.8).label("F3 30 A"))
        drawing.add(elm.Line().right(10.0))
        drawing.add(elm.Switch().right(2.0).label("K1 contactor"))
        drawing.add(elm.Line().tox(41.0).label("36 V, switched"))
        # The computer and the battery divider are ahead of the contactor.
        drawing.add(elm.Fuse().at((8.4, BUS)).down(1.8).label("F4\n5 A", loc="bottom"))
        drawing.add(
            elm.Resistor().down(2.4).label("converters of\ncomputer, boards,\nlaser", loc="bottom")
        )
        drawing.add(elm.Line().toy(0))
        drawing.add(elm.Resistor().at((11.4, BUS)).down(2.6).label("100 kΩ", loc="bottom"))
        drawing.add(elm.Dot())
        drawing.add(elm.Line().right(0.8).label("A0", loc="right"))
        divider = elm.Resistor().at((11.4, BUS - 2.6)).down(2.6)
        drawing.add(divider.label("4.42 kΩ\nbeside it:\n100 nF,\n5.1 V zener", loc="bottom"))
        drawing.add(elm.Line().toy(0))
        # Stop chain: the coil of the contactor, and the precharge behind the same contacts.
        drawing.add(elm.Fuse().at((16.0, BUS)).down(1.5).label("F5 1 A", loc="top"))
        drawing.add(elm.Switch().down(1.4).label("S2 stop", loc="top"))
        drawing.add(elm.Switch().down(1.4).label("S3 opens\nwhile\ncharging", loc="top"))
        chained = drawing.here
        start = drawing.add(elm.Button().down(1.4).label("S5 start", loc="top"))
        drawing.add(elm.Line().at(start.start).right(0.9))
        drawing.add(elm.Switch().down(1.4).label("K1\nauxiliary", loc="bottom"))
        drawing.add(elm.Line().left(0.9))
        drawing.move_from(start.end)
        _coil(drawing, "K1 coil")
        drawing.add(elm.Line().toy(0))
        drawing.add(elm.Line().at(chained).right(2.0))
        drawing.add(elm.Button().right(1.4).label("S4\nprecharge", loc="bottom"))
        drawing.add(elm.Resistor().up(2.4).label("100 Ω\n25 W", loc="bottom"))
        drawing.add(elm.Line().toy(BUS))
        # Behind the contactor.
        drawing.add(elm.Resistor().at((22.0, BUS)).down(4).label("bleed\n2.2 kΩ\n2 W", loc="top"))
        drawing.add(elm.Line().toy(0))
        _driver(drawing, 24.0, "left")
        _driver(drawing, 29.0, "right")
        _coil_of_board(drawing, 33.6, "left\nbrake", "PL3")
        _coil_of_board(drawing, 37.0, "right\nbrake", "PL3")
        _coil_of_board(drawing, 41.0, "K2", "PL2\nby S6")
        ground = elm.Line().at((0, 0)).right(43.2)
        drawing.add(ground.label("0 V: one star point at the packs", loc="bottom"))


if __name__ == "__main__":
    draw()
    print(f"wrote {OUTPUT}")
