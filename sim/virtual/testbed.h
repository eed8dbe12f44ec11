/*
 * The /dev and /sys of devices that are not there: one umockdev testbed, shared by all virtual
 * devices of the process and seen by it and its children. A process sees it only with umockdev's
 * library preloaded (testbed_enter()).
 *
 * Main thread only; the devices' own functions run in umockdev's thread.
 */
#pragma once

#include <umockdev.h>

/* Starts the program again with what must be preloaded, unless it is. For main(), first. */
void testbed_enter(char **argv);

/* One a device, given back by testbed_unref(). */
UMockdevTestbed *testbed_ref(void);
void testbed_unref(void);
