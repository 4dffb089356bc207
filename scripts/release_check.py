# SPDX-License-Identifier: Apache-2.0
"""
Refuse a release if the manifest has placeholders or the changelog has no dated section.

    .venv/bin/python scripts/release_check.py

The fields are those of package.xml; setup.py and docs/conf.py read them from there.
"""
from pathlib import Path
import re
import sys
import xml.etree.ElementTree as ElementTree

ROOT = Path(__file__).resolve().parent.parent
PLACEHOLDER = '.invalid'  # a top-level domain that is reserved for names that do not exist
URLS = ('repository', 'bugtracker')


def problems(manifest: str, changelog: str) -> 'list[str]':
    """Return the problems of package.xml and CHANGELOG.rst, given as text, for a release."""
    package = ElementTree.fromstring(manifest)
    version = package.findtext('version')
    found = []
    maintainer = package.find('maintainer')
    fields = {'maintainer email': maintainer.get('email', ''),
              **{f'url type="{kind}"': package.findtext(f"url[@type='{kind}']") or ''
                 for kind in URLS}}
    for name, value in fields.items():
        if not value or PLACEHOLDER in value:
            found.append(f'package.xml: {name} is {value!r}; fill in the real one')
    heading = rf'^{re.escape(version)} \(\d{{4}}-\d\d-\d\d\)\n-+$'
    if not re.search(heading, changelog, re.MULTILINE):
        found.append(f'CHANGELOG.rst: no section "{version} (YYYY-MM-DD)"; date the section '
                     'Forthcoming, as catkin_prepare_release does')
    return found


def main() -> int:
    found = problems(*((ROOT / name).read_text(encoding='utf-8')
                       for name in ('package.xml', 'CHANGELOG.rst')))
    print('\n'.join(found) or 'ready for a release')
    return bool(found)


if __name__ == '__main__':
    sys.exit(main())
