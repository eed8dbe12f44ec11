/* From trigger to picture of a virtual USB3 Vision camera, for bench_usb. */
#pragma once

#include "drivers/clock.h"

/* µs, n of each: the bare protocol by libusb, and the driver. A failure ends the program. */
void u3v_measure(Clock *clock, int n, double *ret_raw_us, double *ret_driver_us);
