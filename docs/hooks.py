"""What the builder of the site does beside rendering Markdown."""

import re
from typing import Any


def on_page_content(html: str, page: Any, **_: Any) -> str:
    """Let links of notebooks, which name Markdown files, lead to pages."""
    if not page.file.src_uri.endswith(".ipynb"):
        return html
    return re.sub(r'href="(\.\./\w+)\.md', r'href="\1.html', html)
