"""Entry of `python -m juncnet_services.radon_preprocessing`."""

from juncnet_services.radon_preprocessing.service import main

main()
