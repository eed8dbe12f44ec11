/*
 * Locks of real devices, so that only one process has a device open. A device is a serial line, a
 * USB device, a camera, or a unit of a board on the network. A process keeps the lock while it has
 * the device open, also while the device is lost and searched for. The kernel releases the lock
 * when the process ends for any reason. A stopped process keeps it.
 *
 * A lock is a listening socket in the abstract namespace of AF_UNIX. Its name is the key of the
 * device. A connection to the socket tells which process holds it (SO_PEERCRED), even if that
 * process hangs. Abstract names are the same for all users, and in every sandbox that shares the
 * network, as the sandbox of the service does. They leave no file behind.
 *
 * Lock files would not work, because the service runs as another user than the daemons of ordinary
 * users. The service shares no writable folder with these daemons (ProtectSystem=strict,
 * PrivateTmp=yes), and it cannot read /proc/locks and the command lines of other users.
 *
 * A container with a separate network does not see these locks. There the lock of the line itself
 * (drivers/modbus/serial.h) and the kernel's locks of USB interfaces still protect the device.
 * Anybody who may run programs on the computer can take a name, but such a person can also switch a
 * board on the network.
 *
 * Programs that make a rig safe (mesorigd --safe-state, the guardian) take no lock, because a
 * daemon that starts meanwhile must not fail because of them. See enum lock_role.
 *
 * Any thread may call these functions. Errors are DEVICE_ERROR.
 */
#pragma once

#include <glib.h>
#include <sys/types.h>

typedef struct Lock Lock;

enum lock_role {
    /* The default. Takes the lock, or fails. If the device is LOCK_ALONE and another program is
     * making it safe, lock_take() first waits up to five seconds for that program. */
    LOCK_OWNER,
    /* For the work of a guardian after the end of a daemon. lock_take() fails if another process
     * has the lock, or if the device is LOCK_ALONE and another process is making it safe. */
    LOCK_GUARDIAN,
    /* For an operator who requests the safe state. lock_take() fails if the device is LOCK_ALONE
     * and another process has the lock or is making the device safe. */
    LOCK_OPERATOR,
};

/* Sets the role of the whole process. */
void lock_set_role(enum lock_role role);
enum lock_role lock_get_role(void);

enum lock_kind {
    LOCK_ALONE,  /* two programs would garble each other's requests */
    LOCK_SHARED, /* the device serves several programs, such as a board on the network */
};

/* Takes the lock of a device. `what` names the device in the error, for example "/dev/ttyUSB0". The
 * error is DEVICE_ERROR_BUSY. It names the process that has the device and says what to do. A
 * second lock of the same key also fails in the same process, so sections that use the same device
 * share one lock. */
Lock *lock_take(const char *key, enum lock_kind kind, const char *what, GError **error);
void lock_release(Lock *lock); /* NULL is ignored */
const char *lock_key(const Lock *lock);

/* Returns whether a process holds the lock. *ret_pid is the number of that process, or 0 if it is
 * not known. The function does not take the lock. */
gboolean lock_holder(const char *key, pid_t *ret_pid);

/* Each lock_take() that finds the lock taken notes the number of the process that holds it, whether
 * lock_take() then fails or not. lock_steal_found() returns the number that was noted last, and
 * forgets it. Returns 0 if none was noted since the last call, or if the number is not known. */
pid_t lock_steal_found(void);

/* Returns the name of a process: "mesorigd --rig rig.conf (process 708)", or "process 708" if its
 * command line cannot be read, or "another program" if pid is 0. Free it with g_free(). */
char *lock_process(pid_t pid);

/* Returns whether the process is known to be a mesorigd that has opened a rig or is about to. */
gboolean lock_is_daemon(pid_t pid);

/* Returns the key of the device behind a device node. All links to the node have the same key. kind
 * is "serial", "usb" or "video". Returns NULL if there is no such node. Free it with g_free(). */
char *lock_key_of_node(const char *kind, const char *path);
