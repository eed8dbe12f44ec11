/* Messages between preparer.c and preparer_child.c. */
#pragma once

#include "preparer.h"

/* In a request: version; who asks; task; limits of time and memory; structs of geometry and timing
 * as they are in memory, since both sides are the same program; the rig's text and path;
 * calibration (empty: none) and the days it is good for; session file; directory; texts of session
 * and calibration (empty: to be read); what was chosen of the session file; a struct bus_caller, or
 * nothing. */
#define PREPARER_REQUEST_TYPE "(siiutayayayayaydayayayayayay)"
#define PREPARER_REQUEST      "(siiut@ay@ay^ay^ay^ayd^ay^ay^ay^ay^ay@ay)"

/* In an answer: domain (empty: no error), code and message of an error; the result. */
#define PREPARER_ANSWER "(sisv)"
