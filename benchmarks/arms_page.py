"""The tables of real arms, and the page of the documentation that is made of them."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.measure import RESULTS, header, table

STEM = "arm-table"
"""Of the names of the results."""

PAGE = Path(__file__).parents[1] / "docs" / "arms.md"

Row = dict[str, Any]

_TITLE = """# Real arms: which is solved how, and how well

Made by `python -m benchmarks.arms --only table --save`, never by hand. Poses are made by forward
kinematics (in numpy) from joint vectors within the limits, so each has a solution that is known:
at random, and near singular postures, where the smallest singular value of the Jacobian (metres
and radians) is 1e-3, 1e-6 or 1e-9."""

_RIGHT = """No answer was called complete, and no pose out of reach, falsely; no joint vector
missed its pose."""

_SIX = """- *solutions*: how many a random pose has, in the mean and at most.
- *made-by*: of the random poses, those among whose answers is the joint vector that made them
  (to 1e-4 rad).
- *recall*: of the solutions that Newton's method in numpy finds from {starts} guesses for each of
  {searched} random poses, those that are among the answers.
- *complete*: of the random poses, those of which it is said that there is no other solution.
- *1e-3, 1e-6, 1e-9*: made-by near singular postures, and behind the stroke complete. What is not
  made-by there is answered by others, by one that is named as one of infinitely many, or not at
  all; where the answer is called complete nevertheless, the claim is false and stands above."""

_SEVEN = """An arm of seven or eight joints has curves of solutions; up to 16 of them are
returned. The share of poses answered within the limits, at random and near singular postures.
Nothing is said to be complete, and nothing is. *ssik*: the share that it answers within the
limits, and microseconds a pose: by its own artefact where it comes with one, else by its class,
which by its own word covers less than an artefact that is built first."""

_KINDS = """*Found*: made-by (below), of arms of seven and eight joints answered within the
limits; of all arms of the kind. *Complete*: of random poses. The first arm of each kind is timed
on one core in float64, once compiled. *poses/s*: {speed:,} random poses in one call (fewer where
the solver is not complete). *One pose*: alone in a call. *First answer*: CPU seconds of a fresh
process without a cache, from its start to the solutions of one pose, imports and compilation
included."""

_PEERS = """Each library that is installed solves the same poses in the same run, one pose at a
time (eaik by its batched call, one thread). Below each is niryo_jax on the arms that it solves,
and on those poses. *Solved*: the arms of up to six joints of whose random poses it finds the
joint vectors of half or more. *Recall*: its share of all solutions known of {searched} random
poses of an arm, by any library, by the search, or by ours. *1e-3* to *1e-9*: made-by, and behind
the stroke answered at all. *Spurious*: claimed solutions that miss by more than 1e-6 m or rad.
*us a pose*: the median of the arms; ours in a batch, and in brackets alone, of the arm of its
kind that was timed. *Preparation*: seconds for an arm before its first pose, median and most;
ours is compilation, above. roboticstoolbox takes long to prepare and is asked for one arm of each
kind; what is not prepared within {prepare} s takes no part."""


def percent(part: float, whole: float) -> str:
    """100 % only where nothing is missing."""
    if not whole:
        return "none"
    share = 100 * part / whole
    if share in (0, 100):
        return f"{share:.0f} %"
    return f"{min(share, 99.9):.1f} %"


def in_short(row: Row) -> str:
    """A line while it runs."""
    sets = {name: (s["made-by"], s["complete"], s["poses"]) for name, s in row["sets"].items()}
    spent = row.get("seconds a pose", {})
    peers = {
        name: (round(peer.get("recall", -1), 4), [s["made-by"] for s in peer["sets"].values()])
        for name, peer in row["peers"].items()
    }
    return (
        f"{row['kind']} {sets} first call {row['first call']:.1f} s, {spent}, "
        f"first answer {row.get('first answer')}, {peers}, {row['seconds']:.0f} s"
    )


def sections(data: dict[str, Any]) -> list[str]:
    """All tables with what their columns mean."""
    arms: dict[str, Row] = data["arms"]
    effort = data["effort"]
    six = {name: row for name, row in arms.items() if row["joints"] <= 6}
    seven = {name: row for name, row in arms.items() if row["joints"] > 6}
    found = ["## By the kind of arm", table(*_kinds(arms)), _KINDS.format(**effort)]
    if six:
        found += ["## Up to six joints", table(*_six(six)), _SIX.format(**effort)]
    if seven:
        found += ["## Seven and eight joints", table(*_seven(seven)), _SEVEN]
    found.append("Sources: " + "; ".join(f"*{k}*: {v}" for k, v in data["sources"].items()) + ".")
    peers = _peers(six)
    if peers[1]:
        from benchmarks.arms_peers import PREPARE

        text = _PEERS.format(prepare=PREPARE, **effort)
        found += ["## Beside other libraries", table(*peers), text]
        found += ["### Arm by arm", _ARM_BY_ARM, table(*_arm_by_arm(six))]
    found += ["### Where others are ahead", "\n".join(ahead(arms))]
    return found


def collect() -> None:
    """Write docs/arms.md from the last results."""
    for path in sorted(RESULTS.glob(f"*-{STEM}.json"))[-1:]:
        data = json.loads(path.read_text())
        said = "\n".join(f"- WRONG: {x}" for x in data["wrong"]) or _RIGHT
        text = [_TITLE, said, *sections(data), f"Measured with: {header(data['about'])}."]
        PAGE.write_text("\n\n".join(text) + "\n")


def _two_digits(number: float) -> str:
    return f"{float(f'{number:.2g}'):,.0f}"


def of_its_kind(arms: dict[str, Row]) -> dict[str, Row]:
    """Arm -> our seconds a pose in a batch and alone, of the arm of its kind that was timed."""
    known = dict[tuple[Any, ...], Row]()
    for row in arms.values():
        spent = row.get("seconds a pose", {})
        if "batch" in spent:
            known.setdefault((row["joints"], *row["kind"]), spent)
    kinds = {name: (row["joints"], *row["kind"]) for name, row in arms.items()}
    return {name: known[kind] for name, kind in kinds.items() if kind in known}


def _near(row: Row, count: Callable[[dict[str, int]], str]) -> list[str]:
    return [count(s) if s["poses"] else "none" for k, s in row["sets"].items() if k != "random"]


def _six(arms: dict[str, Row]) -> tuple[Sequence[str], list[list[str]]]:
    head = ["arm", "joints", "source", "family", "solver", "solutions", "made-by", "recall"]
    head += ["complete", "1e-3", "1e-6", "1e-9"]
    lines = []
    for name, row in arms.items():
        random, searched = row["sets"]["random"], row["searched"]
        lines.append(
            [
                name,
                str(row["joints"]),
                row["source"],
                *row["kind"],
                f"{row['solutions']:.1f}, {row['most']}",
                percent(random["made-by"], random["poses"]),
                percent(searched["found"], searched["known"]),
                percent(random["complete"], random["poses"]),
                *_near(
                    row,
                    lambda s: (
                        f"{percent(s['made-by'], s['poses'])} / "
                        f"{percent(s['complete'], s['poses'])}"
                    ),
                ),
            ]
        )
    return head, lines


def _seven(arms: dict[str, Row]) -> tuple[Sequence[str], list[list[str]]]:
    head = ["arm", "joints", "source", "family", "solver", "random", "1e-3", "1e-6", "1e-9"]
    head += ["ssik"]
    lines = []
    for name, row in arms.items():
        random, ssik = row["sets"]["random"], row["peers"].get("ssik")
        beside = row["absent"].get("ssik", "")
        if ssik is not None:
            parts = ssik["sets"]["random"]
            beside = percent(parts["found"], parts["poses"]) + _micros(row, "ssik")
        lines.append(
            [
                name,
                str(row["joints"]),
                row["source"],
                *row["kind"],
                percent(random["in limits"], random["poses"]),
                *_near(row, lambda s: percent(s["in limits"], s["poses"])),
                beside,
            ]
        )
    return head, lines


def _micros(row: Row, peer: str) -> str:
    each = row.get("seconds a pose", {}).get(peer)
    return "" if each is None else f", {1e6 * each:,.0f} us"


def _kinds(arms: dict[str, Row]) -> tuple[Sequence[str], list[list[str]]]:
    kinds = dict[tuple[str, ...], list[Row]]()
    for row in arms.values():
        joints = "7, 8" if row["joints"] > 6 else str(row["joints"])
        kinds.setdefault((*row["kind"], joints), []).append(row)
    head = ["family", "solver", "joints", "arms", "found, random", "found, near", "complete"]
    head += ["poses/s", "one pose (us)", "first answer (s)"]
    lines = []
    for (family, solver, joints), rows in kinds.items():
        what = "in limits" if joints == "7, 8" else "made-by"
        random = [row["sets"]["random"] for row in rows]
        near = [s for row in rows for name, s in row["sets"].items() if name != "random"]
        timed = [row["seconds a pose"] for row in rows if "batch" in row.get("seconds a pose", {})]
        firsts = [row["first answer"] for row in rows if "first answer" in row]
        lines.append(
            [
                family,
                solver,
                joints,
                str(len(rows)),
                *(percent(sum(s[what] for s in x), _total(x)) for x in (random, near)),
                percent(sum(s["complete"] for s in random), _total(random)),
                _two_digits(1 / timed[0]["batch"]) if timed else "",
                _two_digits(1e6 * timed[0]["alone"]) if timed else "",
                f"{min(firsts):.1f}" if firsts else "",
            ]
        )
    return head, lines


def _total(sets: list[dict[str, int]]) -> int:
    return sum(s["poses"] for s in sets)


def solved(peer: Row) -> bool:
    """Whether it finds half of the joint vectors at random."""
    return 2 * peer["sets"]["random"]["made-by"] >= peer["sets"]["random"]["poses"]


def _peers(arms: dict[str, Row]) -> tuple[Sequence[str], list[list[str]]]:
    names = list(dict.fromkeys(name for row in arms.values() for name in row["peers"]))
    head = ["library", "solved", "recall", "made-by, random", "1e-3", "1e-6", "1e-9", "spurious"]
    head += ["us a pose", "preparation (s)"]
    ours = of_its_kind(arms)
    lines = []
    for name in names:
        asked = [row for row in arms.values() if name in row["peers"]]
        rows = [row for row in asked if solved(row["peers"][name])]
        if not rows:
            continue
        theirs = [row["peers"][name] for row in rows]
        before = [peer["preparation"] for peer in theirs]
        each = [row["seconds a pose"][name] for row in rows if "seconds a pose" in row]
        lines.append(
            [
                name,
                f"{len(rows)} of {len(asked) + _refused(arms, name)}",
                f"{100 * statistics.fmean(peer['recall'] for peer in theirs):.2f} %",
                *_shares([peer["sets"] for peer in theirs]),
                f"{sum(peer['spurious'] for peer in theirs)} of "
                f"{sum(peer['claimed'] for peer in theirs):,}",
                f"{1e6 * statistics.median(each):,.0f}" if each else "",
                f"{statistics.median(before):.1f}, {max(before):.0f}",
            ]
        )
        spent = [ours[arm] for arm, row in arms.items() if arm in ours and row in rows]
        batch, alone = ([1e6 * x[which] for x in spent] for which in ("batch", "alone"))
        lines.append(
            [
                "niryo_jax, the same arms",
                f"{len(rows)}",
                f"{100 * statistics.fmean(row['recall of all'] for row in rows):.2f} %",
                *_shares([row["beside"] for row in rows]),
                str(sum(row["spurious"] for row in rows)),
                f"{statistics.median(batch):,.1f} ({statistics.median(alone):,.0f})"
                if batch
                else "",
                "",
            ]
        )
    return head, lines


def _refused(arms: dict[str, Row], name: str) -> int:
    return sum(row["absent"].get(name, "skipped") != "skipped" for row in arms.values())


def _shares(sets: list[dict[str, dict[str, int]]]) -> list[str]:
    cells = []
    for name in sets[0]:
        these = [s[name] for s in sets]
        shares = [
            percent(sum(s[what] for s in these), _total(these)) for what in ("made-by", "found")
        ]
        cells.append(shares[0] if name == "random" else " / ".join(shares))
    return cells


_ARM_BY_ARM = """Recall of all solutions known; made-by at 1e-3, 1e-6 and 1e-9 together;
microseconds a pose (ours in a batch)."""


def _arm_by_arm(arms: dict[str, Row]) -> tuple[Sequence[str], list[list[str]]]:
    names = list(dict.fromkeys(name for row in arms.values() for name in row["peers"]))
    spent = of_its_kind(arms)
    lines = []
    for arm, row in arms.items():
        ours = f", {1e6 * spent[arm]['batch']:,.1f} us" if arm in spent else ""
        line = [arm, _cell(row["recall of all"], row["beside"]) + ours]
        for name in names:
            peer = row["peers"].get(name)
            if peer is None:
                reason = row["absent"].get(name, "")
                line.append("" if reason == "skipped" else reason)
            elif not solved(peer):
                line.append(f"recall {100 * peer['recall']:.0f} %")
            else:
                line.append(_cell(peer["recall"], peer["sets"]) + _micros(row, name))
        lines.append(line)
    return ["arm", "niryo_jax", *names], lines


def _cell(recall: float, sets: dict[str, dict[str, int]]) -> str:
    near = [s for name, s in sets.items() if name != "random"]
    share = percent(sum(s["made-by"] for s in near), _total(near))
    return f"{percent(recall, 1)}, near {share}"


def ahead(arms: dict[str, Row]) -> list[str]:
    """What other libraries do better, of what was measured here."""
    more, sooner, faster, limits = (dict[str, list[str]]() for _ in range(4))
    near, ours = dict[str, list[str]](), of_its_kind(arms)
    for arm, row in arms.items():
        for name, peer in row["peers"].items():
            if row["joints"] > 6:
                theirs, mine = (x["random"] for x in (peer["sets"], row["beside"]))
                if theirs["found"] * mine["poses"] > mine["found"] * theirs["poses"]:
                    limits.setdefault(name, []).append(arm)
            elif peer["recall"] > row["recall of all"]:
                more.setdefault(name, []).append(arm)
            if row["joints"] <= 6:
                better = [
                    size
                    for size, s in peer["sets"].items()
                    if size != "random" and s["made-by"] > row["beside"][size]["made-by"]
                ]
                if better:
                    near.setdefault(name, []).append(f"{arm} ({', '.join(better)})")
            if arm in ours and (row["joints"] > 6 or solved(peer)):
                each = row["seconds a pose"][name]
                if each < ours[arm]["alone"]:
                    sooner.setdefault(name, []).append(arm)
                if each < ours[arm]["batch"]:
                    faster.setdefault(name, []).append(arm)
    lines = []
    for text, found in (
        ("finds more solutions of random poses", more),
        ("finds more of the joint vectors near singular postures", near),
        ("answers more poses within the limits", limits),
        ("is faster than our batch", faster),
        ("answers a single pose sooner", sooner),
    ):
        lines += [f"- {name} {text}: {_listed(names)}." for name, names in found.items()]
    if any(row["peers"] for row in arms.values()):
        lines.append(
            "- All of them answer their first pose without compiling; ssik, eaik and ikdh run "
            "without JAX: where a few poses are asked for once they are done before ours starts."
        )
        lines.append(
            "- ssik samples the whole curve of solutions of an arm of seven joints (up to hundreds "
            "for a pose), of which ours returns 16."
        )
    return lines or ["No other library was installed."]


def _listed(names: list[str]) -> str:
    return (
        ", ".join(names)
        if len(names) <= 12
        else f"{', '.join(names[:6])} and {len(names) - 6} more"
    )
