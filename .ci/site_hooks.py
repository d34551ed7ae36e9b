"""MkDocs hooks: files of the repository that pages link to become pages of the site.

Pages in docs/ are read in the repository too, where they link to code, examples and tables beside docs/.  In
the site such a file is a page below repository/: Markdown as it is, everything else as a listing of its text.
A link to a folder leads to its index.md, or to a list of its files.  A link to a file that does not exist is
an error of the build.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

LINK = re.compile(r"(\]\()([^)\s#:]+)(#[^)\s]*)?(\))")
FENCE = re.compile(r"^(`{3,})[^\n]*\n.*?^\1$", re.MULTILINE | re.DOTALL)
BELOW = "repository"
ALWAYS = ("SECURITY.md", "CONTRIBUTING.md", "CHANGELOG.md")
"""Pages of the navigation, whether others link to them or not."""
LANGUAGES = {".py": "python", ".toml": "toml", ".sh": "bash", ".json": "json", ".yml": "yaml"}
SKIPPED = {"__pycache__"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages below repository/: what docs/ links to, and what those pages link to."""
    docs = Path(config.docs_dir)
    root = docs.parent
    waiting = [docs / file.src_uri for file in files.documentation_pages()]
    waiting += [root / name for name in ALWAYS]
    done: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path in done:
            continue
        done.add(path)
        if not path.is_relative_to(docs):
            content = page_of(path)
            files.append(File.generated(
                config, uri_of(path, docs), content=content, inclusion=InclusionLevel.NOT_IN_NAV
            ))  # fmt: skip
        if path.is_dir() or path.suffix == ".md":
            waiting += outside(path, docs)
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Leads links out of docs/, and to folders, to the pages that stand for them."""
    docs = Path(config.docs_dir)
    here = PurePosixPath(page.file.src_uri)
    source = path_of(page.file.src_uri, docs)

    def led(link: re.Match[str]) -> str:
        target = target_of(source, link[2])
        inside = target.is_relative_to(docs)
        if not target.exists():
            raise PluginError(f"{here}: the link to {link[2]} leads nowhere.")
        if source.is_relative_to(docs) and inside and target.is_file():
            return link[0]
        uri = os.path.relpath(uri_of(target, docs), here.parent)
        return f"{link[1]}{uri}{link[3] or ''}{link[4]}"

    return "".join(part if code else LINK.sub(led, part) for part, code in parts(markdown))


def parts(markdown: str) -> Iterator[tuple[str, bool]]:
    """The text in pieces, each with whether it is a fenced block, in which nothing is a link."""
    at = 0
    for fence in FENCE.finditer(markdown):
        yield markdown[at : fence.start()], False
        yield fence[0], True
        at = fence.end()
    yield markdown[at:], False


def outside(path: Path, docs: Path) -> Iterator[Path]:
    """Files and folders beside docs/ that a page links to, or that a listed folder holds."""
    if path.is_dir():
        yield from (one for one in listed(path) if not one.is_dir())
        return
    for piece, code in parts(path.read_text(encoding="utf-8")):
        for link in () if code else LINK.finditer(piece):
            target = target_of(path, link[2])
            if target.exists() and not target.is_relative_to(docs):
                yield target


def target_of(path: Path, link: str) -> Path:
    """Where a link of a page leads."""
    return Path(os.path.normpath(path.parent / link))


def uri_of(path: Path, docs: Path) -> str:
    """The address of a file's or folder's page within the site's sources."""
    if path.is_relative_to(docs):
        uri = path.relative_to(docs).as_posix()
        return f"{uri}/index.md" if path.is_dir() else uri
    uri = f"{BELOW}/{path.relative_to(docs.parent).as_posix()}"
    if path.is_dir():
        return f"{uri}/index.md"
    return uri if path.suffix == ".md" else f"{uri}.md"


def path_of(uri: str, docs: Path) -> Path:
    """The inverse of `uri_of`: the file that links of a page are relative to."""
    if not uri.startswith(f"{BELOW}/"):
        return docs / uri
    path = docs.parent / uri.removeprefix(f"{BELOW}/")
    if path.exists():
        return path
    return path if path.name == "index.md" else path.with_suffix("")


def listed(folder: Path) -> list[Path]:
    return sorted(one for one in folder.iterdir() if one.name not in SKIPPED)


def page_of(path: Path) -> str:
    """The page that stands for a file or folder beside docs/."""
    if path.is_dir():
        rows = [f"* [{one.name}]({one.name})" for one in listed(path) if not one.is_dir()]
        return "\n".join([f"# {path.name}", "", *rows, ""])
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return text
    fence = 6 * "`"  # longer than any in the text
    return f"# {path.name}\n\n{fence}{LANGUAGES.get(path.suffix, 'text')}\n{text}\n{fence}\n"
