/*
 * The /dev and /sys of virtual devices: one umockdev testbed, shared by all virtual devices of the
 * process and seen by it and its children. A process sees it only with umockdev's
 * library preloaded (testbed_enter()).
 *
 * Main thread only; the devices' own functions run in umockdev's thread.
 */
#pragma once

#include <umockdev.h>

/* Starts the program again with umockdev's library preloaded, unless it is preloaded already. To be
 * called first in main(). */
void testbed_enter(char **argv);

/* Whether the library was preloaded. */
gboolean testbed_is_entered(void);

/* Each device takes one reference, and gives it back by testbed_unref(). */
UMockdevTestbed *testbed_ref(void);
void testbed_unref(void);

/* Connects like g_signal_connect(), for functions that umockdev's threads call.
 * testbed_disconnect() disconnects all functions with this data, and returns when their calls under
 * way have ended. */
void testbed_connect(UMockdevIoctlBase *handler, const char *signal, GCallback func, gpointer data);
void testbed_disconnect(UMockdevIoctlBase *handler, gpointer data);
