/* Messages between preparer.c and preparer_child.c. */
#pragma once

#include "preparer.h"

/* The request contains, in this order:
 * - its version, the caller and the task,
 * - the limits of time and memory,
 * - structs of geometry and timing as they are in memory, because both sides are the same program,
 * - the text and the path of the rig file,
 * - the calibration (empty for none) and the days for which it is valid,
 * - the session file and the directory,
 * - the texts of session and calibration (empty if they have to be read),
 * - the values that were chosen for the session file,
 * - a struct bus_caller, or nothing. */
#define PREPARER_REQUEST_TYPE "(siiutayayayayaydayayayayayay)"
#define PREPARER_REQUEST      "(siiut@ay@ay^ay^ay^ayd^ay^ay^ay^ay^ay@ay)"

/* The answer contains domain (empty for no error), code and message of an error, and the result. */
#define PREPARER_ANSWER "(sisv)"
