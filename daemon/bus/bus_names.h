/* Names and limits of the D-Bus interface, for the daemon and its clients. */
#pragma once

#define BUS_NAME "org.mesorig.Rig1"
#define BUS_PATH "/org/mesorig/Rig1"
/* Name of a file in the directory of the session that is being captured. The file contains the
 * address of the daemon that captures the session. */
#define BUS_CONTROL "control"

/* Maximum length in seconds of the lease of a lamp or laser that a client switches on by hand. */
#define BUS_MAX_LEASE_S 60
