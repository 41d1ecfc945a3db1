"""Recordings: every message of a flight in MCAP files, and back. Needs the extra [record].

A message that travels as JSON lies in a channel of its own key, with its JSON schema. The fields of
a `BulkMessage` lie there too, and its payload, under the same sequence, in `KEY/payload`: pictures
as `foxglove.CompressedVideo` and `foxglove.CompressedImage`, as viewers open them. What viewers
draw of other messages (a pose, a fix, a line of the log) is written beside them, for viewers only.
"""

from juncnet.extras import install_command

PAYLOAD = "/payload"
"""End of the name of a channel with the payloads of bulk messages."""
FLIGHT_METADATA = "juncnet.flight"
"""Metadata record: which flight, robot, version, clock and wall clock."""
LAYOUT_ATTACHMENT = "layout.json"
"""Attachment: the layout with all its settings, as `juncnet.layout.load_layout` reads it."""
SUFFIX = ".mcap"
MISSING = f"recordings need the extra [record]: {install_command('record')}"
