/*
 * What the marks on the turntable said of the lamps while a session was captured: of each shot and
 * camera, the lamp's output relative to what the session's calibration says. Kept as the session's
 * values "lamp_output/SHOT/CAMERA" = "OUTPUT ERROR" (standard error). One thread at a time.
 */
#pragma once

#include "session.h"

/* Capture, before the shot is committed; a later take replaces it. */
gboolean outputs_store(Session *session, gint64 shot, const char *camera, double output,
                       double output_error, GError **error);

/* By shot: of all cameras, each counted by its standard error. A shot in which no camera saw a mark
 * has what the nearest shots of its lamp before and after it have, in between by number. A lamp
 * none of whose shots showed a mark, and a session without marks, has 1. */
struct outputs;
struct outputs *outputs_load(Session *session, const GPtrArray *shots, GError **error);
void outputs_free(struct outputs *outputs); /* NULL is ignored */
double outputs_of(const struct outputs *outputs, gint64 shot);
int outputs_measured(const struct outputs *outputs); /* how many shots have one of their own */
