"""Entry of `python -m juncnet_services.junction_navigation`."""

from juncnet_services.junction_navigation.service import main

if __name__ == "__main__":
    main()
