/*
 * A umockdev testbed has the /dev and /sys of virtual devices. All virtual devices of the process
 * share one testbed. The process and its children see the testbed only with umockdev's library
 * preloaded (testbed_enter()).
 *
 * Only the main thread may call these functions. The functions of the devices run in umockdev's
 * thread.
 */
#pragma once

#include <umockdev.h>

/* Starts the program again with umockdev's library preloaded. Does nothing if the library is
 * preloaded already. Call this function first in main(). */
void testbed_enter(char **argv);

/* Returns whether the library is preloaded. */
gboolean testbed_is_entered(void);

/* Returns the testbed. Each device takes a reference, and releases it with testbed_unref(). */
UMockdevTestbed *testbed_ref(void);
void testbed_unref(void);

/* testbed_connect() works like g_signal_connect(), for functions that umockdev's threads call.
 * testbed_disconnect() disconnects all functions with this data, and waits until no thread is
 * calling one of them. */
void testbed_connect(UMockdevIoctlBase *handler, const char *signal, GCallback func, gpointer data);
void testbed_disconnect(UMockdevIoctlBase *handler, gpointer data);
