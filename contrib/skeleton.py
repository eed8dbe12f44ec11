"""Code that new-driver and new-codec share. It fills templates and adds lines to tables."""
import os
import re
import shutil
import subprocess
import sys

CONTRIB = os.path.dirname(os.path.abspath(__file__))


class Skeleton:
    """New and changed files of the source tree in the folder root. Only save() writes them."""

    def __init__(self, root, words):
        self.root, self.words = root, words
        self.new, self.changed = {}, {}
        if not os.path.exists(os.path.join(root, "ARCHITECTURE.md")):
            sys.exit(f"{root} is not the source tree of Mesorig; run this script in its top folder")

    def fill(self, template, path):
        """Makes a new file from a template. Each @WORD@ in it is replaced by its value in words."""
        for folder, _, names in os.walk(os.path.join(self.root, path.split("/")[0])):
            if os.path.basename(path) in names:
                there = os.path.relpath(os.path.join(folder, os.path.basename(path)), self.root)
                sys.exit(f"a file of this name exists: {there}; choose another name")
        with open(os.path.join(CONTRIB, template), encoding="utf-8") as file:
            text = file.read()
        for word, value in self.words.items():
            text = text.replace(f"@{word}@", value)
        self.new[path] = text

    def find(self, folder, pattern):
        """Returns the first source file below a folder that matches a regular expression, or None."""
        for at, _, names in sorted(os.walk(os.path.join(self.root, folder))):
            for name in sorted(names):
                full = os.path.join(at, name)
                if name.endswith((".c", ".h")):
                    with open(full, encoding="utf-8") as file:
                        if re.search(pattern, file.read()):
                            return os.path.relpath(full, self.root)
        return None

    def read(self, path):
        if path in self.changed:
            return self.changed[path]
        with open(os.path.join(self.root, path), encoding="utf-8") as file:
            return file.read()

    def change(self, path, pattern, new):
        """Replaces the first match of a regular expression in an existing file."""
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
    """Returns the name as a C identifier, with underscores instead of hyphens."""
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        sys.exit(
            f"{name!r} is not a name: begin with a letter, and use lower-case letters, digits and "
            "hyphens, as in acme-axis"
        )
    return name.replace("-", "_")
