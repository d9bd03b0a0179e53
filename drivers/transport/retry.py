"""Where drivers of before take `Repeatable` from: it is in `exchanges`."""

from drivers.transport.exchanges import Repeatable as Repeatable
