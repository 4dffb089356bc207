# SPDX-License-Identifier: Apache-2.0
"""
The protocols as pure functions and parsers: bytes in, messages out; no port, no clock.

Every parser has ``feed(data)``, which takes bytes in pieces of any size and returns the messages
that they complete.  It finds its way back through garbage, and gives nothing that its checksum
does not vouch for.
"""
