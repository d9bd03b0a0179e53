"""Where drivers of before take lines over VISA from: they are in `text_line`."""

from drivers.transport.text_line import ScpiDriver as ScpiDriver
from drivers.transport.text_line import VisaLine as VisaLine
from drivers.transport.text_line import VisaSettings as VisaSettings

ScpiLine = VisaLine
