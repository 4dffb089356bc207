# SPDX-License-Identifier: Apache-2.0
"""
Generate the pages of the documentation site whose sources are outside of docs/, and adapt links.

Links in the Markdown files are relative paths between files, as on a Git host. README.md and
other files outside of docs/ are copied to docs/generated/, and every link to a file that is a page
of the site becomes a link to that page.
"""
import base64
import json
import os
from pathlib import Path
import re

ROOT = Path(__file__).resolve().parent.parent
GENERATED = 'generated'
# Files outside of docs/ -> pages of the site.
COPIED = {'README.md': 'readme.md', 'CONTRIBUTING.md': 'contributing.md',
          'QUALITY_DECLARATION.md': 'quality_declaration.md', 'CHANGELOG.rst': 'changelog.rst',
          'interfaces/README.md': 'interfaces.md', 'examples/paper.ipynb': 'paper.md'}
FOLDER = re.compile(r'\[([^][]+)\]\(([^)#\s:]+)\)')
LINK = re.compile(r'(\]\()([^)#\s]+)((?:#[^)]*)?\))')
# The sections of docs/index.md are the table of contents.
SECTION = re.compile(r'^## (.+)$', re.MULTILINE)
ENTRY = re.compile(r'^\* \[([^]]+)\]\(([^)]+)\)', re.MULTILINE)


def write(docs):
    """Write all pages into docs/generated/."""
    folder = docs / GENERATED
    folder.mkdir(exist_ok=True)
    pages = {page: (ROOT / file).read_text(encoding='utf-8') for file, page in COPIED.items()}
    pages['paper.md'] = notebook(pages['paper.md'], folder)
    for file, page in COPIED.items():
        if page.endswith('.md'):
            pages[page] = followed(pages[page], ROOT / file, folder / page, docs)
    for name, text in pages.items():
        path = folder / name
        # Sphinx rereads files that are newer than its last build.
        if not path.exists() or path.read_text(encoding='utf-8') != text:
            path.write_text(text, encoding='utf-8')


def notebook(text, folder):
    """Return a notebook as Markdown, with the output of its cells; write its pictures."""
    parts = []
    for number, cell in enumerate(json.loads(text)['cells']):
        source = ''.join(cell['source'])
        if cell['cell_type'] == 'markdown':
            parts.append(source)
            continue
        parts.append(f'```python\n{source}\n```')
        for output in cell['outputs']:
            data = output.get('data', {})
            if 'image/png' in data:
                name = f'paper_{number}.png'
                (folder / name).write_bytes(base64.b64decode(data['image/png']))
                # As a link in the source, which `followed` adapts below.
                parts.append(f'![What the cell above draws](../docs/{GENERATED}/{name})')
            else:
                shown = ''.join(output.get('text') or data['text/plain'])
                parts.append(f'```text\n{shown.rstrip()}\n```')
    return '\n\n'.join(parts) + '\n'


def followed(text, source, page, docs):
    """
    Return Markdown with its links adapted to a page in the folder of all pages, `docs`.

    The links of the given text are relative to its file, `source`.
    """
    pages = {(ROOT / file).resolve(): docs / GENERATED / page for file, page in COPIED.items()}

    def replaced(match):
        target = match.group(2)
        if '://' in target or target.startswith('mailto:'):
            return match.group()
        absolute = (source.parent / target).resolve()
        if absolute.is_relative_to(ROOT / 'docs'):
            absolute = docs / absolute.relative_to(ROOT / 'docs')
        relative = os.path.relpath(pages.get(absolute, absolute), page.parent)
        return f'{match.group(1)}{relative}{match.group(3)}'

    def plain(match):
        # A folder is not a page: a Git host links it, the site only names it.
        return match.group(1) if (source.parent / match.group(2)).is_dir() else match.group()
    return LINK.sub(replaced, FOLDER.sub(plain, text))


def source_read(app, docname, source):
    """Adapt the links of a page as Sphinx reads it; the first page also gets its contents."""
    page = Path(app.env.doc2path(docname))
    docs = Path(app.srcdir)
    if page.suffix == '.md' and docname.split('/')[0] != GENERATED:
        source[0] = followed(source[0], ROOT / 'docs' / f'{docname}.md', page, docs)
    if docname == 'index':
        source[0] += contents(source[0])


def contents(text):
    """Return the tables of contents of a page whose sections are lists of links."""
    _, *parts = SECTION.split(text)
    tables = []
    for title, body in zip(parts[::2], parts[1::2]):
        entries = [f'{words} <{page}>' for words, page in ENTRY.findall(body)
                   if page.endswith(('.md', '.rst'))]
        tables.append('\n```{toctree}\n:hidden:\n:caption: ' + title + '\n\n'
                      + '\n'.join(re.sub(r'\.(md|rst)\b', '', line) for line in entries)
                      + '\n```\n')
    return ''.join(tables)
