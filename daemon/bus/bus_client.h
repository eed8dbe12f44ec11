/*
 * How clients reach a daemon of their own user that listens at an address (mesorigd --listen). Each
 * such daemon is found in one folder of the user's, whatever its address: FOLDER/mesorig-XXXXXX/bus
 * is its socket, or a link to it. Main loop's thread.
 */
#pragma once

#include <gio/gio.h>

/* The environment variable with the address to use where the command line names no daemon. */
#define BUS_CLIENT_VARIABLE "MESORIG_ADDRESS"

/* Its value; NULL: it is not set, or empty. */
const char *bus_client_address(void);

/* Where the folders of daemons are: of XDG_RUNTIME_DIR, or else for temporary files. */
const char *bus_client_folder(void);

/* Makes a folder there that only this user may read, and removes it with "bus" and "log" in it;
 * g_free(). */
char *bus_client_make_folder(GError **error);
void bus_client_remove_folder(const char *folder);

/* Lets clients of the same user find the daemon that listens at "unix:path=…". Returns the folder
 * to remove at its end, g_free(); NULL without an error: its socket is in such a folder already. */
char *bus_client_announce(const char *address, GError **error);

/* A connection to the daemon at an address, within 5 s. Errors name the address and say how a
 * daemon is started there; G_IO_ERROR_NOT_FOUND or G_IO_ERROR_CONNECTION_REFUSED: no process
 * listens there. The waiting one runs the default main context meanwhile. */
void bus_client_connect_async(const char *address, GCancellable *cancellable,
                              GAsyncReadyCallback callback, gpointer data);
GDBusConnection *bus_client_connect_finish(GAsyncResult *result, GError **error);
GDBusConnection *bus_client_connect(const char *address, GError **error);
