"""What mkdocs asks for while it builds the site: pages from elsewhere, generated parts, links.

README.md, CONTRIBUTING.md and CHANGELOG.md are pages of the site, too. Files of the repository
that pages link come along as text, so that the site is whole without a network.
"""

from pathlib import Path
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

from tools.pages.links import led, left_out, loaded_from_elsewhere, PAGES, ROOT, sources_linked
from tools.pages.reference import filled

# Lets the search work where the site is read from the disk.
_WORKER = 'iframe-worker.js'


def on_config(config: Any) -> Any:  # noqa: ANN401 - mkdocs' own
    """Give pages that the navigation does not name a place at its end."""
    if pages := left_out(config.nav):
        config.nav.append({'More': pages})
    return config


def on_files(files: Files, *, config: Any) -> Files:  # noqa: ANN401 - mkdocs' own
    """Add the pages from elsewhere, and the sources that pages link."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text()))
    worker = Path(__file__).with_name(_WORKER).read_text()
    files.append(File.generated(config, f'assets/{_WORKER}', content=worker))
    pages = [file for file in files if file.src_uri.endswith('.md')]
    sources = {it for page in pages for it in sources_linked(page.content_string, page.src_uri)}
    for path in sorted(sources):
        text = (ROOT / path).read_text()
        files.append(File.generated(config, f'source/{path}.txt', content=text))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:  # noqa: ANN401
    """Fill in what is generated, and lead links to where things are on the site."""
    return led(filled(markdown), page.file.src_uri)


def on_post_page(output: str, *, page: Any, **_: Any) -> str:  # noqa: ANN401
    """Refuse a page that is not whole without a network."""
    if addresses := loaded_from_elsewhere(output):
        raise PluginError(f'{page.file.src_uri}: loads {", ".join(addresses)}')
    return output
