"""`python -m juncnet_services.frame_capture`."""

from juncnet_services.frame_capture.service import main

main()
