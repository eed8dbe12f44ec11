"""Shared by new-driver and new-codec: fills templates and adds lines to tables."""
import os
import re
import shutil
import subprocess
import sys

CONTRIB = os.path.dirname(os.path.abspath(__file__))


class Skeleton:
    """Files of the tree in a folder. Nothing is written before save()."""

    def __init__(self, root, words):
        self.root, self.words = root, words
        self.new, self.changed = {}, {}
        if not os.path.exists(os.path.join(root, "ARCHITECTURE.md")):
            sys.exit(f"{root} is not the source tree of Mesorig")

    def fill(self, template, path):
        """A new file, from a template in which each @WORD@ is replaced."""
        for _, _, names in os.walk(os.path.join(self.root, path.split("/")[0])):
            if os.path.basename(path) in names:
                sys.exit(f"there is a {os.path.basename(path)} already: choose another name")
        with open(os.path.join(CONTRIB, template), encoding="utf-8") as file:
            text = file.read()
        for word, value in self.words.items():
            text = text.replace(f"@{word}@", value)
        self.new[path] = text

    def read(self, path):
        if path not in self.changed:
            with open(os.path.join(self.root, path), encoding="utf-8") as file:
                self.changed[path] = file.read()
        return self.changed[path]

    def change(self, path, pattern, new):
        """Replaces the first match of a pattern."""
        text, n = re.subn(pattern, new, self.read(path), count=1, flags=re.DOTALL | re.MULTILINE)
        if n == 0:
            sys.exit(f"{path}: cannot find {pattern!r}; add {new!r} by hand")
        self.changed[path] = text

    def save(self, next_steps):
        for path, text in {**self.new, **self.changed}.items():
            full = os.path.join(self.root, path)
            os.makedirs(os.path.dirname(full), exist_ok=True)
            with open(full, "w", encoding="utf-8") as file:
                file.write(text)
            if path.endswith((".c", ".h")) and shutil.which("clang-format"):
                subprocess.run(["clang-format", "-i", full], check=True)
        for path in self.new:
            print(f"new:     {path}")
        for path in self.changed:
            print(f"changed: {path}")
        print("\nNext:\n" + "\n".join(f"{i}. {step}" for i, step in enumerate(next_steps, 1)))


def identifier(name):
    """The name in C."""
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        sys.exit(f"{name!r} is not a name: take small letters, digits and hyphens, as in acme-axis")
    return name.replace("-", "_")
