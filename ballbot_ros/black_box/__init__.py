# SPDX-License-Identifier: Apache-2.0
"""
The last ten minutes of a session, as an MCAP file after a fault.

``ring`` keeps MCAP messages in memory, ``dump`` writes them to a file, ``read`` reads it, and
``report`` converts it to text and tables.  Foxglove opens the file, too.
"""
