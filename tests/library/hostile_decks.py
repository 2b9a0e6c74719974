"""More than 150 hostile decks.

A careless reader would build wrong meshes from them, or exhaust memory or time.
`HOSTILE_DECK_FILES_AND_REFUSAL_BY_NAME` maps the name of each case to its files, of which
"deck.inp" is read, and to a flag. The flag states whether the deck has to be refused (True), has to
be read (False), or may be either (None). A mesh that is read has to agree with an independent
reading.
"""

import random

from tests.library.deck_models import DECKS_BY_ELEMENT_TYPE

LONG_DECK_SIZE_IN_CHARACTERS = 900_000  # size of long decks

VALID_DECK_OF_TWO_QUADS = """*NODE
1, 0., 0.
2, 1., 0.
3, 2., 0.
4, 0., 1.
5, 1., 1.
6, 2., 1.
*ELEMENT, TYPE=CPS4, ELSET=E
1, 1, 2, 5, 4
2, 2, 3, 6, 5
"""
SIX_NODE_TRIANGLE_DECK_TEMPLATE = """*NODE
1, 0., 0.
2, 1., 0.
3, 0., 1.
4, {middle}
5, .5, .5
6, 0., .5
*ELEMENT, TYPE=CPS6
1, 1, 2, 3, 4, 5, 6
"""
TEN_NODE_TETRAHEDRON_DECK_TEMPLATE = """*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
5, {middle}
6, .5, .5, 0.
7, 0., .5, 0.
8, 0., 0., .5
9, .5, 0., .5
10, 0., .5, .5
*ELEMENT, TYPE=C3D10
1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10
"""


def make_lines_until_size(make_line, min_characters=LONG_DECK_SIZE_IN_CHARACTERS):
    """Return lines `make_line(k)` for k = 0, 1, ... that together reach a minimum size."""
    lines, length = [], 0
    while length < min_characters:
        lines.append(make_line(len(lines)))
        length += len(lines[-1]) + 1
    return "\n".join(lines) + "\n"


def make_square_grid_deck(cells_per_side):
    """Return a deck of n x n quadrilaterals, with n the number of cells per side."""
    n_columns = cells_per_side + 1
    lines = ["*NODE,NSET=N"] + [
        f"{k + 1},{k % n_columns},{k // n_columns}" for k in range(n_columns * n_columns)
    ]
    lines.append("*ELEMENT,TYPE=CPS4,ELSET=E")
    for k in range(cells_per_side * cells_per_side):
        a = k // cells_per_side * n_columns + k % cells_per_side + 1
        lines.append(f"{k + 1},{a},{a + 1},{a + n_columns + 1},{a + n_columns}")
    return "\n".join(lines) + "\n"


def _yield_decks_with_unusual_numbers():
    """Yield decks with invalid numbers, and with numbers in unusual notation."""
    for text in ("nan", "inf", "-Infinity", "1e999", "-1D400", "1e300", "1_0", "0x1p3", "1,5.5.5"):
        yield (
            f"coordinate {text}",
            VALID_DECK_OF_TWO_QUADS.replace("3, 2., 0.", f"3, {text}, 0."),
            True,
        )
    for text in ("1.5+3", "1 2", "١", "--1", "1.0F", "1d", "<h>", "'1'", "1e1e1", "\x0b1", "\xa01"):
        yield (
            f"coordinate {text!r}",
            VALID_DECK_OF_TWO_QUADS.replace("3, 2., 0.", f"3, {text}, 0."),
            True,
        )
    for text in (
        "2.D0",
        "+2.",
        "2.d+00",
        ".2E1",
        "20e-1",
        "0002",
        " 2 ",
        "\t2.",
        "2.0000000000000001",
    ):
        yield (
            f"coordinate {text!r}",
            VALID_DECK_OF_TWO_QUADS.replace("3, 2., 0.", f"3, {text}, 0."),
            False,
        )
    for text in (
        "0",
        "-3",
        "3.0",
        "3e0",
        "٣",
        "3_0",
        "99999999999999999999",
        "2147483648",
        "",
        "x",
    ):
        yield (
            f"node {text!r}",
            VALID_DECK_OF_TWO_QUADS.replace("3, 2., 0.", f"{text}, 2., 0."),
            True,
        )
    for text in ("0", "-1", "1.", "²", "1e0", "99999999999", "7 7", "9" * 5000, "", "0x2"):
        yield (
            f"node of an element {text!r}",
            VALID_DECK_OF_TWO_QUADS.replace("2, 2, 3,", f"2, 2, {text},"),
            True,
        )
    yield "empty coordinates", VALID_DECK_OF_TWO_QUADS.replace("4, 0., 1.", "4, , 1., ,"), False
    yield "no coordinates", VALID_DECK_OF_TWO_QUADS.replace("1, 0., 0.", "1"), False
    yield (
        "coordinates and a normal",
        VALID_DECK_OF_TWO_QUADS.replace("3, 2., 0.", "3, 2., 0., 0., 0., 0., 1."),
        False,
    )
    yield (
        "eight entries",
        VALID_DECK_OF_TWO_QUADS.replace("3, 2., 0.", "3, 2., 0., 0., 0., 0., 1., 4."),
        True,
    )


def _yield_decks_with_repeated_or_degenerate_cells():
    """Yield decks with repeated, missing or degenerate nodes, elements and cells."""
    yield "an element twice", VALID_DECK_OF_TWO_QUADS + "1, 2, 3, 6, 5\n", True
    yield "an element twice, the same", VALID_DECK_OF_TWO_QUADS + "1, 1, 2, 5, 4\n", True
    yield (
        "an element twice, a spring",
        VALID_DECK_OF_TWO_QUADS + "*ELEMENT, TYPE=SPRINGA\n1, 1, 2\n",
        True,
    )
    yield "a cell twice", VALID_DECK_OF_TWO_QUADS + "3, 1, 2, 5, 4\n", True
    yield "a cell twice, turned", VALID_DECK_OF_TWO_QUADS + "3, 5, 4, 1, 2\n", True
    yield (
        "a cell twice, in other types",
        VALID_DECK_OF_TWO_QUADS + "*ELEMENT, TYPE=CPE4\n3, 5, 4, 1, 2\n",
        True,
    )
    yield "a node twice", VALID_DECK_OF_TWO_QUADS + "*NODE\n3, 2., .5\n", True
    yield "a node twice, the same", VALID_DECK_OF_TWO_QUADS + "*NODE\n3, 2., 0.\n", False
    yield "a node missing", VALID_DECK_OF_TWO_QUADS.replace("6, 2., 1.\n", ""), True
    yield "a row too short", VALID_DECK_OF_TWO_QUADS.replace("2, 2, 3, 6, 5", "2, 2, 3, 6"), True
    yield (
        "rows of five and three",
        VALID_DECK_OF_TWO_QUADS.replace("1, 1, 2, 5, 4", "1, 1, 2, 5"),
        True,
    )
    yield (
        "a row too long",
        VALID_DECK_OF_TWO_QUADS.replace("2, 2, 3, 6, 5", "2, 2, 3, 6, 5, 1"),
        None,
    )
    yield "rows of other cells", VALID_DECK_OF_TWO_QUADS.replace("CPS4", "CPS3"), None
    yield "rows of twice the nodes", VALID_DECK_OF_TWO_QUADS.replace("CPS4", "CPS8"), True
    yield (
        "a collapsed cell",
        VALID_DECK_OF_TWO_QUADS.replace("2, 2, 3, 6, 5", "2, 2, 3, 6, 6"),
        True,
    )
    yield "a crossed cell", VALID_DECK_OF_TWO_QUADS.replace("2, 2, 3, 6, 5", "2, 2, 6, 3, 5"), True
    yield (
        "a flat cell",
        VALID_DECK_OF_TWO_QUADS.replace("6, 2., 1.", "6, 2., 0.").replace("5, 1., 1.", "5, 1., 0."),
        True,
    )
    yield (
        "a cell upon another",
        VALID_DECK_OF_TWO_QUADS.replace("3, 2., 0.", "3, .5, 0.").replace("6, 2.", "6, .5"),
        True,
    )
    yield "no plane", VALID_DECK_OF_TWO_QUADS.replace("6, 2., 1.", "6, 2., 1., .5"), True
    six_nodes = SIX_NODE_TRIANGLE_DECK_TEMPLATE.replace("{middle}", ".5,0.")
    for middle in ("0., 0.", "1., 0.", ".5, .6", "3., 0.", "-1., 0.", ".1, 0."):
        yield (
            f"a middle at {middle}",
            SIX_NODE_TRIANGLE_DECK_TEMPLATE.replace("{middle}", middle),
            True,
        )
        yield (
            f"a middle at {middle}, solid",
            TEN_NODE_TETRAHEDRON_DECK_TEMPLATE.replace("{middle}", f"{middle}, 0."),
            True,
        )
    yield (
        "middles that differ",
        six_nodes + ("2, 3, 2, 7, 11, 8, 9\n*NODE\n7, 1., 1.\n8, 1., .5\n9, .5, 1.\n11, .5, .5\n"),
        True,
    )
    yield (
        "a middle in two edges",
        six_nodes.replace("4, 5, 6\n", "4, 5, 5\n"),
        True,
    )
    yield (
        "a corner that is a middle",
        six_nodes
        + ("2, 3, 5, 7, 8, 9, 10\n*NODE\n7, 1., 1.\n8, .25, .75\n9, .7, .7\n10, .5, 1.\n"),
        True,
    )


def _yield_decks_with_unusual_names_or_sets():
    """Yield decks with similar or invalid names, and with missing members of sets."""
    two_sets = "*NSET,NSET={a}\n1,2\n*NSET,NSET={b}\n2,3\n"
    for a, b in (
        ('"A=B, C"', "AB"),
        ('"A, B"', '"A, C"'),
        ('"A B"', "AB"),
        ('"a"', "A"),
        ("Straße", "STRASSE"),
        ("Ä", "Ö"),
        ("ı", "I"),
        ("ﬁ", "FI"),
        ("ä", "Ä"),
        ("A\xa0B", "AB"),
        ("A.1", "A"),
        ("1A", "A1"),
        ("A" * 90, "A" * 89),
    ):
        yield (
            f"names {a[:9]} and {b[:9]}",
            VALID_DECK_OF_TWO_QUADS + two_sets.format(a=a, b=b),
            False,
        )
        yield (
            f"names {a[:9]} and {b[:9]} in Latin-1",
            (VALID_DECK_OF_TWO_QUADS + two_sets.format(a=a, b=b)).encode(
                "latin-1", errors="replace"
            ),
            None,
        )
    yield (
        "spaces in a name",
        VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A B\n1,2\n*NSET,NSET=C\nAB\n",
        False,
    )
    yield "no name", VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=\n1,2\n", True
    yield "no quotation mark", VALID_DECK_OF_TWO_QUADS + '*NSET,NSET="A\n1,2\n', True
    yield "two names", VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A,NSET=B\n1,2\n", True
    yield (
        "a parameter that is not known",
        VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A,REMOVE\n1,2\n",
        True,
    )
    for set_kind, row in (("NSET", "77"), ("ELSET", "77"), ("NSET", "OTHER"), ("ELSET", "OTHER")):
        yield (
            f"{set_kind} of {row}",
            f"{VALID_DECK_OF_TWO_QUADS}*{set_kind},{set_kind}=A\n1,{row}\n",
            True,
        )
        yield (
            f"{set_kind} of negative",
            f"{VALID_DECK_OF_TWO_QUADS}*{set_kind},{set_kind}=A\n1,-2\n",
            True,
        )
    yield (
        "members twice",
        VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A\n1,1\n*ELSET,ELSET=B\n2,2,E\n",
        False,
    )
    yield "a set of itself", VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A\nA,1,2\n", False
    yield "sets of each other", VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A\nB\n*NSET,NSET=B\nA\n", True
    yield "a surface first", "*SURFACE,NAME=S\nE,S2\n" + VALID_DECK_OF_TWO_QUADS, False
    yield "a surface of nothing", VALID_DECK_OF_TWO_QUADS + "*SURFACE,NAME=S\nNONE,S2\n", True
    yield "a face that is not there", VALID_DECK_OF_TWO_QUADS + "*SURFACE,NAME=S\nE,S5\n", True
    for row in ("9,1", "1", "1,2,0", "1,2,1,1", "1,-2", "a,b", "1.,2.", "7,9", "0,2"):
        yield f"GENERATE {row}", f"{VALID_DECK_OF_TWO_QUADS}*NSET,NSET=A,GENERATE\n{row}\n", True
    yield "GENERATE with gaps", VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A,GENERATE\n2,300,1\n", False
    yield (
        "GENERATE over much",
        VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A,GENERATE\n1,2147483647,1\n",
        False,
    )


def _yield_decks_with_includes_or_encodings():
    """Yield decks with included files, unusual encodings, binary data and unsupported keywords."""
    yield "INCLUDE without INPUT", VALID_DECK_OF_TWO_QUADS + "*INCLUDE\n", True
    yield "INCLUDE of nothing", VALID_DECK_OF_TWO_QUADS + "*INCLUDE,INPUT=\n", True
    yield "INCLUDE that is not there", VALID_DECK_OF_TWO_QUADS + "*INCLUDE,INPUT=none.inp\n", True
    yield "INCLUDE of a folder", VALID_DECK_OF_TWO_QUADS + "*INCLUDE,INPUT=.\n", True
    yield "INCLUDE of a device", VALID_DECK_OF_TWO_QUADS + "*INCLUDE,INPUT=/dev/zero\n", True
    yield "INCLUDE of itself", VALID_DECK_OF_TWO_QUADS + "*INCLUDE,INPUT=deck.inp\n", True
    yield "INCLUDE of itself by another way", {
        "deck.inp": VALID_DECK_OF_TWO_QUADS + "*INCLUDE,INPUT=s/../deck.inp\n", "s/empty": ""
    }, True  # fmt: skip
    levels = {f"{k}.inp": f"*INCLUDE,INPUT={k + 1}.inp\n" * 10 for k in range(9)}
    yield "INCLUDEs of INCLUDEs", {
        **levels, "deck.inp": "*INCLUDE,INPUT=0.inp\n", "9.inp": "** nothing\n"
    }, True  # fmt: skip
    levels = {f"{k}.inp": f"*INCLUDE,INPUT={k + 1}.inp\n" for k in range(20)}
    yield (
        "many levels",
        {**levels, "deck.inp": VALID_DECK_OF_TWO_QUADS + levels["0.inp"], "20.inp": "**\n"},
        True,
    )
    yield (
        "INCLUDE in a block",
        {
            "deck.inp": VALID_DECK_OF_TWO_QUADS.replace(
                "4, 0., 1.\n", "*INCLUDE, INPUT=four.inp\n"
            ),
            "four.inp": "4, 0., 1.",
        },
        False,
    )
    yield "INCLUDE of much, often", {
        "deck.inp": VALID_DECK_OF_TWO_QUADS + "*INCLUDE,INPUT=much.inp\n" * 40,
        "much.inp": "** much\n" * 50_000
    }, True  # fmt: skip
    for name, data in (
        ("nothing", b""), ("zeros", bytes(1000)),
        ("a zero", VALID_DECK_OF_TWO_QUADS.encode() + b"\0"),
        ("random bytes", random.Random(3).randbytes(5000)), ("half of UTF-16", b"\xff\xfe*\0N"),
        ("a comma", b","), ("an asterisk", b"*"), ("no keyword", b"1, 2, 3\n" * 99),
    ):  # fmt: skip
        yield name, data, True
    yield "UTF-16", VALID_DECK_OF_TWO_QUADS.encode("utf-16"), None
    yield "UTF-8 with its mark", b"\xef\xbb\xbf" + VALID_DECK_OF_TWO_QUADS.encode(), False
    yield "carriage returns", VALID_DECK_OF_TWO_QUADS.replace("\n", "\r").encode(), False
    yield "blanks before keywords", VALID_DECK_OF_TWO_QUADS.replace("*", "  *"), False
    yield (
        "other ends of lines",
        VALID_DECK_OF_TWO_QUADS.replace("*ELEMENT", "** \x0b \x0c \x1c \x85 \u2028\n*ELEMENT"),
        False,
    )
    for keyword in ("NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY", "SYSTEM", "NMAP", "IMPORT"):
        yield keyword, f"{VALID_DECK_OF_TWO_QUADS}*{keyword}\n1, 2, 3\n", True
    yield "cylindrical nodes", VALID_DECK_OF_TWO_QUADS.replace("*NODE", "*NODE, SYSTEM=C"), True
    for kind in ("C3D15", "F3D8", "C3D27", "XYZ4"):
        yield (
            f"elements {kind}",
            f"{VALID_DECK_OF_TWO_QUADS}*ELEMENT, TYPE={kind}\n9, 1, 2, 3, 4\n",
            True,
        )


def _yield_long_decks():
    """Yield decks below 1 MB that could take excessive memory or time."""
    ranges = make_lines_until_size(lambda k: f"1,{2**31 - 1 - k},{1 + k % 5000}", 400_000)
    mesh = make_square_grid_deck(70)
    yield "one long line", "*NODE\n" + "1," * (LONG_DECK_SIZE_IN_CHARACTERS // 2), True
    yield "a long keyword", "*NODE" + ",\n" + ",\n".join(f"A{k}=1" for k in range(90_000)), True
    yield "blank lines", VALID_DECK_OF_TWO_QUADS + "\n" * LONG_DECK_SIZE_IN_CHARACTERS, False
    yield "comments", VALID_DECK_OF_TWO_QUADS + "** \n" * (LONG_DECK_SIZE_IN_CHARACTERS // 4), False
    yield "keywords", VALID_DECK_OF_TWO_QUADS + "*A\n" * (LONG_DECK_SIZE_IN_CHARACTERS // 3), False
    yield (
        "quotation marks",
        VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A\n" + '"",' * (LONG_DECK_SIZE_IN_CHARACTERS // 3),
        None,
    )
    yield (
        "commas",
        VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A\n1" + "," * LONG_DECK_SIZE_IN_CHARACTERS,
        False,
    )
    yield "ranges", mesh + "*NSET,NSET=A,GENERATE\n" + ranges, None
    yield (
        "ranges of few numbers",
        VALID_DECK_OF_TWO_QUADS + "*NSET,NSET=A,GENERATE\n" + ranges,
        None,
    )
    yield (
        "sets of ranges",
        mesh + make_lines_until_size(lambda k: f"*NSET,NSET=A{k},GENERATE\n1,5000", 500_000),
        None,
    )
    yield (
        "sets of all",
        mesh + make_lines_until_size(lambda k: f"*NSET,NSET=A{k}\nN", 500_000),
        None,
    )
    yield "a set of all, often", mesh + "*NSET,NSET=A\n" + "N\n" * 200_000, None
    yield (
        "sets of sets",
        mesh
        + "*NSET,NSET=A0\nN\n"
        + make_lines_until_size(
            lambda k: f"*NSET,NSET=A{k + 1}\nA{k},{k + 1}" if k < 5000 else "**", 300_000
        ),
        None,
    )
    yield (
        "doubled sets",
        mesh
        + "*NSET,NSET=A0\nN\n"
        + make_lines_until_size(lambda k: f"*NSET,NSET=A{k + 1}\nA{k},A{k},A{k},A{k}", 400_000),
        None,
    )
    yield (
        "sets of elements",
        mesh + make_lines_until_size(lambda k: f"*ELSET,ELSET=A{k}\nE", 500_000),
        None,
    )
    yield (
        "nodes of elements",
        mesh + make_lines_until_size(lambda k: f"*NSET,NSET=A{k},ELSET=E", 500_000),
        None,
    )
    yield (
        "surfaces",
        mesh + make_lines_until_size(lambda k: f"*SURFACE,NAME=A{k}\nE,S{1 + k % 4}", 500_000),
        None,
    )
    yield "a surface of all, often", mesh + "*SURFACE,NAME=A\n" + "E,S1\n" * 90_000, None
    yield (
        "small sets",
        mesh + make_lines_until_size(lambda k: f"*NSET,NSET=A{k}\n{1 + k % 5000}", 500_000),
        False,
    )
    yield (
        "small sets of elements",
        mesh + make_lines_until_size(lambda k: f"*ELSET,ELSET=A{k}\n{1 + k % 4900}", 500_000),
        False,
    )
    yield (
        "nodes",
        VALID_DECK_OF_TWO_QUADS + "*NODE\n" + make_lines_until_size(lambda k: f"{k + 10},1,1"),
        False,
    )
    yield (
        "types",
        VALID_DECK_OF_TWO_QUADS + make_lines_until_size(lambda k: f"*ELEMENT,TYPE=U{k}\n{k + 9}"),
        None,
    )
    yield (
        "parts",
        VALID_DECK_OF_TWO_QUADS + make_lines_until_size(lambda k: f"*PART,NAME=P{k}\n*END PART"),
        None,
    )
    yield (
        "instances",
        make_lines_until_size(
            lambda k: f"*PART,NAME=P{k}\n*END PART\n*INSTANCE,NAME=I{k},PART=P{k}"
        ),
        None,
    )
    yield "INCLUDEs of a file", {
        "deck.inp": VALID_DECK_OF_TWO_QUADS
        + "*INCLUDE,INPUT=e\n" * (LONG_DECK_SIZE_IN_CHARACTERS // 17),
        "e": ""
    }, None  # fmt: skip


def _yield_randomly_mutated_decks():
    """Yield valid decks after changing a random line or character in them."""
    rng = random.Random(41)
    kinds = ("CPS3", "CPS8", "C3D4", "C3D8", "C3D10", "C3D20", "S6", "CAX4")
    for k in range(48):
        text = DECKS_BY_ELEMENT_TYPE[kinds[k % len(kinds)]]
        lines = text.splitlines()
        line_number = rng.randrange(3, len(lines))
        if k % 3 == 0:
            del lines[line_number]
        elif k % 3 == 1:
            lines.insert(line_number, lines[rng.randrange(3, len(lines))])
        else:
            column = rng.randrange(len(lines[line_number]) + 1)
            lines[line_number] = (
                lines[line_number][:column]
                + rng.choice("0123456789,.*-e")
                + lines[line_number][column:]
            )
        yield f"change {k} of {kinds[k % len(kinds)]}", "\n".join(lines) + "\n", None


def _yield_all_hostile_decks():
    for make_cases in (
        _yield_decks_with_unusual_numbers,
        _yield_decks_with_repeated_or_degenerate_cells,
        _yield_decks_with_unusual_names_or_sets,
        _yield_decks_with_includes_or_encodings,
        _yield_long_decks,
        _yield_randomly_mutated_decks,
    ):
        for name, content, is_refused in make_cases():
            files = content if isinstance(content, dict) else {"deck.inp": content}
            yield name, (files, is_refused)


HOSTILE_DECK_FILES_AND_REFUSAL_BY_NAME = dict(_yield_all_hostile_decks())
