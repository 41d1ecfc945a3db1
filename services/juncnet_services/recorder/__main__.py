"""Entry of `python -m juncnet_services.recorder`."""

from juncnet_services.recorder.service import main

main()
