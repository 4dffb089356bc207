# SPDX-License-Identifier: Apache-2.0
"""Messages that are read and written in place, because the middleware is too slow."""
