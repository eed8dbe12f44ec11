/*
 * How clients reach a daemon of the same user that listens at an address (mesorigd --listen). All
 * such daemons are found in one folder of the user, whatever their address:
 * FOLDER/mesorig-XXXXXX/bus is the socket of a daemon, or a link to it. All functions belong to the
 * main loop's thread.
 */
#pragma once

#include <gio/gio.h>

/* Environment variable with the address of the daemon. It is used if the command line names no
 * daemon. */
#define BUS_CLIENT_VARIABLE "MESORIG_ADDRESS"

/* Returns the value of BUS_CLIENT_VARIABLE, or NULL if it is not set or empty. */
const char *bus_client_address(void);

/* Returns whether the value of --bus names a bus: "system" or "session". For any other value,
 * BUS_CLIENT_NO_BUS is the format of the error message. */
gboolean bus_client_is_bus(const char *value);
#define BUS_CLIENT_NO_BUS "there is no --bus=%s; choose from: system, session"

/* Returns the folder that contains the folders of daemons: g_get_user_runtime_dir(), which is
 * XDG_RUNTIME_DIR or, without this variable, the user's cache folder. Returns the folder for
 * temporary files instead if that path is too long for a socket or that folder is not writable. */
const char *bus_client_folder(void);

/* bus_client_make_folder() makes a folder in bus_client_folder() that only this user may read, and
 * returns its path. Free it with g_free(). bus_client_remove_folder() removes such a folder with
 * its files "bus" and "log". */
char *bus_client_make_folder(GError **error);
void bus_client_remove_folder(const char *folder);

/* Lets clients of the same user find the daemon that listens at "unix:path=…". Returns the
 * folder that has to be removed when the daemon ends; free it with g_free(). Returns NULL
 * without an error if the daemon's socket is already in such a folder. Returns NULL with an
 * error if the address has a percent sign without two hexadecimal digits, or if the folder or
 * the link in it cannot be made. */
char *bus_client_announce(const char *address, GError **error);

/* Connects to the daemon at an address. Fails with G_IO_ERROR_TIMED_OUT after 15 s, and with
 * G_IO_ERROR_NOT_FOUND or G_IO_ERROR_CONNECTION_REFUSED if no process listens at the address.
 * Errors name the address and say what to do. bus_client_connect() runs the default main context
 * while it waits. */
void bus_client_connect_async(const char *address, GCancellable *cancellable,
                              GAsyncReadyCallback callback, gpointer data);
GDBusConnection *bus_client_connect_finish(GAsyncResult *result, GError **error);
GDBusConnection *bus_client_connect(const char *address, GError **error);
