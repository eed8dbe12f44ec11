/* Stores and reads the outputs of the lamps during a capture. They are measured on the fiducials on
 * the turntable. A lamp shot has a value for each camera that measured the output, relative to the
 * output in the session's calibration. This value is stored in the session as
 * "lamp_output/SHOT/CAMERA", with the text "OUTPUT ERROR", where ERROR is the standard error. One
 * thread at a time. */
#pragma once

#include "session.h"

/* Stores a measurement. Capture calls this function before it commits the shot. If the shot is
 * taken again, the value is replaced. */
gboolean outputs_store(Session *session, gint64 shot, const char *camera, double output,
                       double output_error, GError **error);

/* outputs_load() computes the output of each shot, and outputs_of() returns it. The output is the
 * mean over all cameras, weighted by 1/σ² (outputs.c).
 *
 * For a shot without a measurement, the output is interpolated linearly, by shot number, between
 * the nearest measured shots of its lamp before and after the shot. If there are measured shots on
 * one side only, the output is that of the nearest of them. The output is 1 if the lamp has no
 * measured shot, for shots without a lamp, and in sessions without fiducials.
 *
 * The error is SESSION_ERROR_FORMAT if a stored value is not valid. */
struct outputs;
struct outputs *outputs_load(Session *session, const GPtrArray *shots, GError **error);
/* Returns the factor that makes an output relative to a calibration other than the session's.
 */
typedef double (*OutputsFactor)(const struct session_shot *shot, const char *camera, gpointer data);
/* Does the same as outputs_load(), for processing with another calibration. Each measured output
 * and its error are multiplied by the factor. */
struct outputs *outputs_load_relative(Session *session, const GPtrArray *shots,
                                      OutputsFactor factor, gpointer data, GError **error);
void outputs_free(struct outputs *outputs); /* NULL is ignored */
double outputs_of(const struct outputs *outputs, gint64 shot);
/* Returns the standard error of a shot's output, or 0 if the output was not measured in this
 * shot. */
double outputs_error(const struct outputs *outputs, gint64 shot);
