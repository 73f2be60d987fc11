"""A URDF description: parsed, checked, and the chain of joints between two of its links."""

from __future__ import annotations

import importlib
import io
import math
import os
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from niryo_jax.arguments import check_path, check_text

_READ = {
    "robot": ("link", "joint"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
}
"""The elements that say how the robot moves, by the element they are in."""

_NUMBERS = {
    "xyz": 3,
    "rpy": 3,
    **dict.fromkeys(("lower", "upper", "effort", "velocity", "multiplier", "offset"), 1),
}
"""How many numbers an attribute holds."""

_MOVING = ("revolute", "continuous", "prismatic")


def parse(path: str | os.PathLike[str]) -> Any:
    """The links and joints of a URDF file, or of its text, as yourdfpy's `Robot`.

    Raises:
        ImportError: yourdfpy is not installed.
        FileNotFoundError: there is no such file.
        ValueError: no XML, no URDF description, or one with incomplete or ambiguous joints.
    """
    try:
        yourdfpy = importlib.import_module("yourdfpy")
    except ImportError as error:
        raise ImportError(
            'from_urdf needs yourdfpy; install it with: pip install "niryo_jax[urdf]"'
        ) from error
    root = document(path)
    _strip(root)
    root.set("name", root.get("name", "robot"))
    # yourdfpy repairs broken XML, takes one number for three, and does not say which joint is
    # incomplete: all of that is found here before it.
    for link in root.findall("link"):
        _attribute(link, "name", "a link")
    for joint in root.findall("joint"):
        _check_joint(joint)
    text = io.BytesIO(ElementTree.tostring(root))
    description = yourdfpy.URDF.load(text, build_scene_graph=False, load_meshes=False).robot
    check_distinct("path: link", (link.name for link in description.links))
    check_distinct("path: joint", (joint.name for joint in description.joints))
    return description


def chain(description: Any, base: str | None, tip: str | None) -> list[Any]:
    """The joints from the base link to the tip link, in order; see `from_urdf`.

    Raises:
        ValueError: the links are not one tree; base or tip is no link; tip is not below base;
            several leaves to choose from; no joint of the chain moves.
    """
    above = _joints_above(description)
    for argument, link in (("base", base), ("tip", tip)):
        if link is not None:
            check_text(argument, link)
    paths = {link.name: _path_to(link.name, above) for link in description.links}
    roots = [link for link, path in paths.items() if not path]
    if len(roots) != 1:
        raise ValueError(
            f"path: expected one tree of links; got {len(roots)} without a parent: {_list(roots)}"
        )
    for argument, link in (("base", base), ("tip", tip)):
        if link is not None and link not in paths:
            raise ValueError(f"{argument}: no link is named {link!r}; the links: {_list(paths)}")
    base = roots[0] if base is None else base
    below = {
        link: path[[joint.parent for joint in path].index(base) :]
        for link, path in paths.items()
        if any(joint.parent == base for joint in path)
    }
    if tip is None:
        parents = {joint.parent for joint in description.joints}
        leaves = [link for link in below if link not in parents]
        if len(leaves) > 1:
            raise ValueError(
                f"tip: several chains start at link {base!r}; choose one of {_list(leaves)}"
            )
        tip = leaves[0] if leaves else base
    if tip != base and tip not in below:
        raise ValueError(f"tip: link {tip!r} is not below the base link {base!r}")
    joints = below.get(tip, [])
    if all(joint.type == "fixed" for joint in joints):
        raise ValueError(f"base, tip: no joint moves between links {base!r} and {tip!r}")
    for joint in joints:
        _check_independent(joint, joints)
    return joints


def check_distinct(what: str, names: Iterable[str]) -> None:
    """Raise a ValueError where a name occurs twice."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"{what} names must be distinct, got {_list(twice)} more than once")


def document(path: str | os.PathLike[str]) -> ElementTree.Element:
    """The root element of a URDF file, or of its text.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: no XML, or no URDF description.
    """
    check_path("path", path)
    text: str | bytes
    if isinstance(path, str) and path.lstrip().startswith("<"):
        text = path.lstrip()
    elif Path(path).is_file():
        text = Path(path).read_bytes()
    else:
        raise FileNotFoundError(
            f"path: {os.fspath(path)!r} is no file; expected a URDF file, or text that starts "
            'with "<"'
        )
    try:
        root = _tree(text)
    except expat.ExpatError as error:
        raise ValueError(f"path: expected XML; {error}") from error
    if _is_xacro(root):
        raise ValueError("path: this is a xacro file; expand it with the program xacro first")
    if root.tag != "robot":
        raise ValueError(f"path: expected the root element <robot>, got <{root.tag}>")
    return root


def _tree(text: str | bytes) -> ElementTree.Element:
    """The elements of a document, under the names that stand there.

    Parsers of URDF know no namespaces: they read prefixes that nobody has declared as parts of
    names, and what is so named says nothing of how a robot moves.
    """
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.Parse(text, True)
    return builder.close()


def _is_xacro(root: ElementTree.Element) -> bool:
    """Whether elements are left that the program xacro replaces."""
    prefixes = {"xacro"}
    for element in root.iter():
        for name, value in element.attrib.items():
            if name.startswith("xmlns:") and value.rstrip("/").endswith("ros.org/wiki/xacro"):
                prefixes.add(name.removeprefix("xmlns:"))
    return any(":" in x.tag and x.tag.split(":")[0] in prefixes for x in root.iter())


def _strip(element: ElementTree.Element) -> None:
    """Remove all that does not say how the robot moves, such as inertias and meshes."""
    for name in list(element.attrib):
        if ":" in name or name == "xmlns":
            del element.attrib[name]
    for child in list(element):
        if child.tag in _READ.get(element.tag, ()):
            _strip(child)
        else:
            element.remove(child)


def _attribute(element: ElementTree.Element | None, name: str, what: str) -> str:
    value = None if element is None else element.get(name)
    if not value:
        raise ValueError(f"path: {what} has no {name}")
    return value


def _check_joint(joint: ElementTree.Element) -> None:
    what = f"joint {_attribute(joint, 'name', 'a joint')!r}"
    _attribute(joint, "type", what)
    for end in ("parent", "child"):
        _attribute(joint.find(end), "link", f"{what}, <{end}>,")
    for element in joint:
        for name, text in element.attrib.items():
            expected = _NUMBERS.get(name)
            if expected is not None and not _are_numbers(text.split(), expected):
                how = "a number" if expected == 1 else f"{expected} finite numbers"
                raise ValueError(
                    f"path: {what}, <{element.tag}> {name}: expected {how}, got {text!r}"
                )


def _are_numbers(words: list[str], expected: int) -> bool:
    """Whether the words are so many numbers; a bound may be infinite, a vector may not."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        return False
    unwanted = math.isnan if expected == 1 else lambda value: not math.isfinite(value)
    return len(values) == expected and not any(map(unwanted, values))


def _joints_above(description: Any) -> dict[str, Any]:
    """The joint that carries each link but the root."""
    links, above = {link.name for link in description.links}, dict[str, Any]()
    for joint in description.joints:
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise ValueError(f"path: joint {joint.name!r}: its {end} {link!r} is no link")
        if joint.child in above:
            raise ValueError(
                f"path: link {joint.child!r} is the child of two joints, "
                f"{above[joint.child].name!r} and {joint.name!r}; expected a tree"
            )
        above[joint.child] = joint
    return above


def _path_to(link: str, above: dict[str, Any]) -> list[Any]:
    """The joints from the root to a link, in order."""
    path: list[Any] = []
    while link in above:
        joint = above[link]
        if joint in path:
            raise ValueError(
                f"path: joints {_list(joint.name for joint in path)} form a loop; expected a tree"
            )
        path.insert(0, joint)
        link = joint.parent
    return path


def _check_independent(joint: Any, joints: list[Any]) -> None:
    """Raise a ValueError unless the joint is fixed, or has a degree of freedom of its own."""
    if joint.type not in ("fixed", *_MOVING):
        raise ValueError(
            f"path: joint {joint.name!r} on the chain is of type {joint.type!r}; "
            f"expected one of {_list(('fixed', *_MOVING))}"
        )
    if joint.type != "fixed" and joint.mimic is not None:
        where = "" if joint.mimic.joint in {other.name for other in joints} else "not "
        raise ValueError(
            f"path: joint {joint.name!r} on the chain mimics joint {joint.mimic.joint!r}, which is "
            f"{where}on the chain; a Robot has no coupled joints. Choose a base and a tip with no "
            "such joint between them"
        )


def _list(names: Iterable[str]) -> str:
    return ", ".join(map(repr, names))
