/*
 * How clients reach a daemon of the same user that listens at an address (mesorigd --listen). To be
 * found, every such daemon makes a folder mesorig-XXXXXX in bus_client_folder(), whatever its
 * address. The file "bus" in it is the socket of the daemon, or a symbolic link to it. All
 * functions belong to the main loop's thread.
 */
#pragma once

#include <gio/gio.h>

/* Environment variable with the address of the daemon. It is used if the command line names no
 * daemon. */
#define BUS_CLIENT_VARIABLE "MESORIG_ADDRESS"

/* Returns the value of BUS_CLIENT_VARIABLE, or NULL if it is not set or empty. */
const char *bus_client_address(void);

/* Returns whether the value of --bus is the name of a bus: "system" or "session". BUS_CLIENT_NO_BUS
 * is the format of the error message for any other value. */
gboolean bus_client_is_bus(const char *value);
#define BUS_CLIENT_NO_BUS "there is no --bus=%s; choose from: system, session"

/* Returns the folder that contains the folders of daemons. This is g_get_user_runtime_dir():
 * XDG_RUNTIME_DIR or, without this variable, the user's cache folder. If the path of that folder is
 * too long for a socket, or the folder is not writable, the folder for temporary files is used
 * instead. */
const char *bus_client_folder(void);

/* bus_client_make_folder() makes a folder in bus_client_folder() that only this user may read, and
 * returns its path. Free it with g_free(). bus_client_remove_folder() removes such a folder with
 * its files "bus" and "log". */
char *bus_client_make_folder(GError **error);
void bus_client_remove_folder(const char *folder);

/* Lets clients of the same user find the daemon that listens at "unix:path=…". Returns the folder
 * that has to be removed when the daemon ends; free the path with g_free(). Returns NULL without an
 * error if the daemon's socket is already in such a folder.
 *
 * Returns NULL with an error if the address has a percent sign without two hexadecimal digits, or
 * if the folder or the link in it cannot be made. */
char *bus_client_announce(const char *address, GError **error);

/* Connect to the daemon at an address. The error is G_IO_ERROR_TIMED_OUT after 15 s, and
 * G_IO_ERROR_NOT_FOUND or G_IO_ERROR_CONNECTION_REFUSED if no process listens at the address.
 * Errors name the address and say what to do. bus_client_connect() runs the default main context
 * while it waits. */
void bus_client_connect_async(const char *address, GCancellable *cancellable,
                              GAsyncReadyCallback callback, gpointer data);
GDBusConnection *bus_client_connect_finish(GAsyncResult *result, GError **error);
GDBusConnection *bus_client_connect(const char *address, GError **error);
