"""`python -m juncnet_services.dashboard`: one that is started anew costs a flight nothing."""

from importlib import import_module

from juncnet.priority import give_way
from juncnet_services.dashboard import NICENESS

give_way(NICENESS)  # before the imports: they are most of the work
import_module("juncnet_services.dashboard.service").main()
