/* USB relay boards with a HID interface (16c0:05df, "USBRelay1" to "USBRelay8"). */
#pragma once

#include "drivers/lamps.h"
#include "drivers/laser.h"

extern const struct lamps_driver usb_relays_driver;
extern const struct laser_driver usb_relay_laser_driver;
