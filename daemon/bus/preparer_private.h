/* Messages between preparer.c and preparer_child.c. */
#pragma once

#include "preparer.h"

/* The request contains, in this order:
 * - the version of mesorigd, the process number of the daemon and the task,
 * - the limits of time and memory,
 * - the structs of geometry and timing as bytes, because both sides are the same program,
 * - the text and the path of the rig file,
 * - the path of the calibration (empty for none) and the number of days for which it is valid,
 * - the paths of the session file and of the session directory,
 * - the texts of session and calibration (empty if they have to be read),
 * - the lines for session_conf_choose() (empty for none),
 * - a struct bus_caller as bytes, or no bytes.
 *
 * PREPARER_REQUEST is the format for g_variant_new(), in which "@ay" stands for structs and "^ay"
 * for texts. */
#define PREPARER_REQUEST_TYPE "(siiutayayayayaydayayayayayay)"
#define PREPARER_REQUEST      "(siiut@ay@ay^ay^ay^ayd^ay^ay^ay^ay^ay@ay)"

/* The answer contains the domain of an error (empty if there is none), its code and its message,
 * and the result. After an error, the result is an empty string. */
#define PREPARER_ANSWER "(sisv)"
