# SPDX-License-Identifier: Apache-2.0
"""A release is refused while a field of the manifest is a placeholder, or no section is dated."""
from pathlib import Path
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'scripts'))

from release_check import problems  # noqa: E402, I100, I202

MANIFEST = """<package><version>1.2.0</version>
<maintainer email="{email}">M</maintainer>
<url type="repository">{repository}</url><url type="bugtracker">https://a.org/issues</url>
</package>"""
DATED = '1.2.0 (2026-11-23)\n------------------\n'


def manifest(email='m@a.org', repository='https://a.org/b'):
    """Return a manifest with these fields."""
    return MANIFEST.format(email=email, repository=repository)


def test_a_complete_manifest_with_a_dated_section_is_ready():
    assert problems(manifest(), DATED) == []


@pytest.mark.parametrize('fields, changelog, named', [
    ({'email': 'm@b.invalid'}, DATED, 'maintainer email'),
    ({'repository': ''}, DATED, 'repository'),
    ({'repository': 'https://b.invalid/c'}, DATED, 'repository'),
    ({}, 'Forthcoming\n-----------\n', 'CHANGELOG'),
    ({}, DATED.replace('1.2.0', '1.1.0'), 'CHANGELOG')])
def test_a_missing_package_is_named(fields, changelog, named):
    found, = problems(manifest(**fields), changelog)
    assert named in found


def test_the_manifest_has_placeholders_until_the_package_has_a_home():
    found = problems((ROOT / 'package.xml').read_text(), (ROOT / 'CHANGELOG.rst').read_text())
    text = (ROOT / 'package.xml').read_text()
    assert ('.invalid' in text) == any('package.xml' in one for one in found)


def test_the_fields_are_stored_in_the_manifest_only():
    for name in ('setup.py', 'docs/conf.py'):
        text = (ROOT / name).read_text()
        assert 'ballbot_ros maintainers' not in text and '.invalid' not in text, name
