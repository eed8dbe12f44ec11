/*
 * Locks of real devices, so that only one process has a device open: a serial line, a USB device, a
 * camera, or a unit of a board on the network. A process keeps the lock of a device while the
 * device is open, also while it is lost and looked for again. The kernel releases the lock when the
 * process ends, however it ends; a stopped process keeps it.
 *
 * A lock is a listening socket in the abstract namespace of AF_UNIX, whose name is the key of the
 * device. Lock files would not serve: the service runs as another user than people's own daemons
 * and sees no writable folder that they see (ProtectSystem=strict, PrivateTmp=yes), and /proc/locks
 * and the command lines of other users are hidden from it. Abstract names are the same for all
 * users and in every sandbox that shares the network, as the sandbox of the service does; they
 * leave no file behind; and a connection to one tells who holds it (SO_PEERCRED), even if that
 * process hangs. A container with a network of its own does not see them. There the lock of the
 * line itself (drivers/modbus/serial.h) and the kernel's own locks of USB interfaces still count.
 * Whoever may run programs on the computer can take a name, as they can switch a board on the
 * network.
 *
 * Programs that make a rig safe (mesorigd --safe-state, the guardian) take no lock, since a daemon
 * that starts meanwhile must not fail because of them: see enum lock_role.
 *
 * Any thread. Errors are DEVICE_ERROR.
 */
#pragma once

#include <glib.h>
#include <sys/types.h>

typedef struct Lock Lock;

enum lock_role {
    LOCK_OWNER, /* the default. Takes the lock, or fails. Waits up to five seconds for a program
                   that is making the device safe. */
    /* Both of these make a rig safe. They fail while another process makes the same LOCK_ALONE
     * device safe. */
    LOCK_GUARDIAN, /* after the end of a daemon: fails if another process has the lock */
    LOCK_OPERATOR, /* for somebody who asks for it: fails only if the device is LOCK_ALONE */
};

/* For the whole process. */
void lock_set_role(enum lock_role role);
enum lock_role lock_get_role(void);

enum lock_kind {
    LOCK_ALONE,  /* two programs would garble each other's requests */
    LOCK_SHARED, /* it serves several programs, such as a board on the network */
};

/* Takes the lock of a device. what names the device in the error, "/dev/ttyUSB0"; the error,
 * DEVICE_ERROR_BUSY, names the process that has it and says what to do. A second lock of the same
 * key fails in the same process, too: sections that share a device share its lock. */
Lock *lock_take(const char *key, enum lock_kind kind, const char *what, GError **error);
void lock_release(Lock *lock); /* NULL is ignored */
const char *lock_key(const Lock *lock);

/* Returns whether a process holds the lock, and which (0: it is not known). Takes nothing. */
gboolean lock_holder(const char *key, pid_t *ret_pid);

/* The process that calls of lock_take() since the last call of this function have found to have a
 * lock, whether they failed because of it or not; 0: none. */
pid_t lock_steal_found(void);

/* "mesorigd --rig rig.conf (process 708)", or "process 708" where its command line cannot be read.
 * g_free() */
char *lock_process(pid_t pid);

/* Whether the process is known to be a mesorigd that has a rig open, or is about to. */
gboolean lock_is_daemon(pid_t pid);

/* The key of what is behind a device node: the same for all links to the node. kind: "serial".
 * NULL: there is no such node. g_free() */
char *lock_key_of_node(const char *kind, const char *path);
