#!/usr/bin/env python3
"""Holds the code's includes against the table of rooms in ARCHITECTURE.md.

usage: check_rooms.py SOURCE_DIR [--table | --draw]

A room is a folder with sources, and the sub-folders that its mesorig_room() names (* for all).
Fails on: a room that is not in the table or is no longer there, an include that the table does not
allow, a pair of rooms that include each other, a circle in the table, and modules of a room (X.c,
X.h, X_private.h) that include each other. --table prints the table as the code has it; --draw
prints it for Graphviz.
"""
import os
import re
import sys

HOUSES = ("base", "calib", "cli", "daemon", "drivers", "processing", "renderer", "sim")
SOURCE = re.compile(r".*\.(c|cpp|h)$")
ROW = re.compile(r"^\| `([a-z0-9_]+)` \| `([a-z0-9_/]+)/` \| [^|]* \| ([^|]*) \|$")


def read_table(path):
    """{room: (folder, set of rooms that it may use)} in the order of the table."""
    table = {}
    with open(path, encoding="utf-8") as page:
        for line in page:
            row = ROW.match(line.rstrip("\n"))
            if row:
                uses = set() if row[3].strip() == "–" else set(row[3].split())
                table[row[1]] = (row[2], uses)
    return table


def find_rooms(root):
    """{folder: [files]} of every room; a file in a sub-folder of its room is SUB/NAME."""
    parts = {
        os.path.normpath(os.path.join(folder, part)): (folder, part + "/")
        for folder, (_, subs) in read_cmake(root).items()
        for part in subs
    }
    rooms = {}
    for house in HOUSES:
        for folder, _, names in os.walk(os.path.join(root, house)):
            files = sorted(name for name in names if SOURCE.match(name))
            folder = os.path.relpath(folder, root)
            room, prefix = parts.get(folder, (folder, ""))
            if files:
                rooms.setdefault(room, []).extend(prefix + name for name in files)
    return rooms


def read_cmake(root):
    """{folder: (rooms that it uses, sub-folders)} of each mesorig_room() of the CMakeLists.txt."""
    found = {}
    for house in HOUSES:
        with open(os.path.join(root, house, "CMakeLists.txt"), encoding="utf-8") as page:
            for call in re.findall(r"mesorig_room\(([^)]*)\)", page.read()):
                lists, into = {}, None
                for word in call.split()[1:]:
                    if word in ("FOLDERS", "USES", "LIBRARIES", "WITHOUT"):
                        into = lists.setdefault(word, [])
                    else:
                        into.append(word)
                folder = os.path.normpath(os.path.join(house, call.split()[0]))
                folders = lists.get("FOLDERS", [])
                if folders == ["*"]:
                    inside = os.scandir(os.path.join(root, folder))
                    folders = sorted(entry.name for entry in inside if entry.is_dir())
                found[folder] = (set(lists.get("USES", [])), folders)
    return found


def includes(path):
    with open(path, encoding="utf-8") as source:
        for number, line in enumerate(source, 1):
            found = re.match(r'\s*#\s*include\s+"([^"]+)"', line)
            if found:
                yield number, found[1]


def find_arrows(root, rooms):
    """(from room, to room) -> ["file:line: header"]; and what cannot be resolved."""
    folders = {os.path.basename(folder): folder for folder in rooms}
    arrows, wrong = {}, []
    for folder, files in rooms.items():
        for name in files:
            for line, header in includes(os.path.join(root, folder, name)):
                where = f"{folder}/{name}:{line}: {header}"
                room, _, rest = header.partition("/")
                here = os.path.join(os.path.dirname(name), header)
                if here in files:
                    continue
                if not rest:
                    if header != "rig1-bus.h":
                        wrong.append(f'{where}: is not in this room; say "room/{header}"')
                elif room not in folders or rest not in rooms[folders[room]]:
                    wrong.append(f"{where}: there is no such room or header")
                elif folders[room] != folder:
                    arrows.setdefault((os.path.basename(folder), room), []).append(where)
                elif os.path.dirname(name) == os.path.dirname(rest):
                    wrong.append(f'{where}: is in this folder; say "{os.path.basename(rest)}"')
    return arrows, wrong


def find_modules(root, folder, files):
    """{module: set of modules of the same room that it includes}."""

    def module_of(name):
        return re.sub(r"_private$", "", os.path.splitext(name)[0])

    room = os.path.basename(folder)
    modules = {module_of(name): set() for name in files}
    for name in files:
        for _, header in includes(os.path.join(root, folder, name)):
            here = os.path.normpath(os.path.join(os.path.dirname(name), header))
            used = here if here in files else header.removeprefix(room + "/")
            if used in files and module_of(used) != module_of(name):
                modules[module_of(name)].add(module_of(used))
    return modules


def find_circles(modules):
    """Sorted tuples of the modules that include each other, directly or by others."""
    reached = {}
    for module in modules:
        seen, left = set(), [module]
        while left:
            for used in modules[left.pop()] - seen:
                seen.add(used)
                left.append(used)
        reached[module] = seen
    return {
        tuple(sorted(other for other in seen if module in reached[other]))
        for module, seen in reached.items()
        if module in seen
    }


def check_modules(root, rooms):
    return [
        f"{folder}: {' '.join(circle)} include each other; move what the lower one needs of the "
        "higher one to where it belongs"
        for folder, files in sorted(rooms.items())
        for circle in sorted(find_circles(find_modules(root, folder, files)))
    ]


def check_circles(table):
    """Rooms of the table in which no order exists."""
    left = {room: set(uses) for room, (_, uses) in table.items()}
    while True:
        free = [room for room, uses in left.items() if not uses & left.keys()]
        if not free:
            return sorted(left)
        for room in free:
            del left[room]


def words(names):
    return " ".join(sorted(names)) or "–"


def check(root, table, rooms):
    arrows, wrong = find_arrows(root, rooms)
    listed = {folder: room for room, (folder, _) in table.items()}
    for folder in rooms:
        if listed.get(folder) != os.path.basename(folder):
            wrong.append(
                f"{folder}/: ARCHITECTURE.md has no row `{os.path.basename(folder)}` for it"
            )
    for folder, room in listed.items():
        if folder not in rooms:
            wrong.append(f"ARCHITECTURE.md: `{room}`: there are no sources in {folder}/")
    for (user, used), where in sorted(arrows.items()):
        if user in table and used not in table[user][1]:
            wrong += [f"{place}: `{user}` may not use `{used}`" for place in where]
        if user < used and (used, user) in arrows:
            wrong.append(
                f"`{user}` and `{used}` include each other: {where[0]} and "
                f"{arrows[used, user][0]}"
            )
    for room, (_, uses) in table.items():
        wrong += [
            f"ARCHITECTURE.md: `{room}` may use `{used}`, but does not"
            for used in sorted(uses)
            if (room, used) not in arrows
        ]
    for folder, (uses, _) in read_cmake(root).items():
        row = table.get(os.path.basename(folder), ("", set()))[1]
        if uses != row:
            needed = {used for user, used in arrows if user == os.path.basename(folder)}
            wrong.append(
                f"{folder}: mesorig_room() has {words(uses)}, and ARCHITECTURE.md has {words(row)}; "
                f"write in both what the includes need: {words(needed)}"
            )
    circle = check_circles(table)
    if circle:
        wrong.append("ARCHITECTURE.md: no order of floors fits " + " ".join(circle))
    return wrong + check_modules(root, rooms)


def main():
    root = sys.argv[1]
    table = read_table(os.path.join(root, "ARCHITECTURE.md"))
    rooms = find_rooms(root)
    if "--table" in sys.argv or "--draw" in sys.argv:
        arrows, _ = find_arrows(root, rooms)
        for folder in rooms:
            room = os.path.basename(folder)
            uses = sorted(used for user, used in arrows if user == room)
            if "--draw" in sys.argv:
                print("\n".join(f"{room} -> {used};" for used in uses))
            else:
                print(f"| `{room}` | `{folder}/` | | {words(uses)} |")
        return 0
    wrong = check(root, table, rooms)
    for what in wrong:
        print(what)
    print(f"{len(table)} rooms, {len(wrong)} wrong")
    return 1 if wrong or not table else 0


sys.exit(main())
