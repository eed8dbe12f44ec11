/* Names and limits of the interface that daemon and clients know. */
#pragma once

#define BUS_NAME "org.mesorig.Rig1"
#define BUS_PATH "/org/mesorig/Rig1"
/* File in a session directory that contains the address of the daemon that captures the session. */
#define BUS_CONTROL "control"

/* The longest lease of a lamp or laser that a client has switched on by hand. */
#define BUS_MAX_LEASE_S 60
