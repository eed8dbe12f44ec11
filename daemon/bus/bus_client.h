/*
 * How clients reach a daemon of their own user that listens at an address (mesorigd --listen). Each
 * such daemon is found in one folder of the user's, whatever its address: FOLDER/mesorig-XXXXXX/bus
 * is its socket, or a link to it. Main loop's thread.
 */
#pragma once

#include <gio/gio.h>

/* The environment variable with the address to use where the command line names no daemon. */
#define BUS_CLIENT_VARIABLE "MESORIG_ADDRESS"

/* The value of BUS_CLIENT_VARIABLE; NULL: it is not set, or empty. */
const char *bus_client_address(void);

/* The folder in which the folders of daemons are: XDG_RUNTIME_DIR, or else that for temporary
 * files. */
const char *bus_client_folder(void);

/* The first function makes a folder in bus_client_folder() that only this user may read, and
 * returns its path, g_free(). The second removes such a folder with the files "bus" and "log". */
char *bus_client_make_folder(GError **error);
void bus_client_remove_folder(const char *folder);

/* Lets clients of the same user find the daemon that listens at "unix:path=…". Returns the folder
 * that is to be removed when the daemon ends, g_free(); NULL without an error: the daemon's socket
 * is in such a folder already. */
char *bus_client_announce(const char *address, GError **error);

/* Connects to the daemon at an address, within 5 s. Errors name the address and say how a daemon is
 * started there; G_IO_ERROR_NOT_FOUND or G_IO_ERROR_CONNECTION_REFUSED: no process listens there.
 * bus_client_connect() runs the default main context while it waits. */
void bus_client_connect_async(const char *address, GCancellable *cancellable,
                              GAsyncReadyCallback callback, gpointer data);
GDBusConnection *bus_client_connect_finish(GAsyncResult *result, GError **error);
GDBusConnection *bus_client_connect(const char *address, GError **error);
