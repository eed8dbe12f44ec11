/*
 * The material so far of the session that the daemon captures, for the web server's requests
 * (processing/partial). Two threads of low priority work: one reads the session's new pictures and
 * predicts the pictures that clients ask for, the other one predicts the expected error every few
 * seconds, with at most a sixteenth of a processor. The session is only read. All functions belong
 * to the main loop's thread, and all but web_material_free() return immediately.
 */
#pragma once

#include <glib.h>

typedef struct WebMaterial WebMaterial;

/* Called with the data of a server-sent event "material", which is one line of JSON. Its members
 * are "session", "measured" (number of measured pictures), "new" (pairs that were measured since
 * the last event), "forecast" (a number that changes with each prediction), and "expected_error",
 * "expected_error_range" and "later", as in web_material_text(). */
typedef void (*WebMaterialNews)(const char *json, gpointer data);
WebMaterial *web_material_new(WebMaterialNews news, gpointer data);
/* Waits for the threads of the session that is followed. NULL is ignored. */
void web_material_free(WebMaterial *material);

/* Follows a session. NULL or an empty text stands for no session. Does nothing if the session is
 * the same as before. */
void web_material_follow(WebMaterial *material, const char *directory);

/* Returns the material so far as JSON; g_free(). Returns NULL with an error if there is no session,
 * or if it cannot be read. The members are:
 * - session, width, height (texels), width_mm, height_mm
 * - views, lights: lists of [θ, φ] in degrees
 * - view_rings, light_rings: lists of indices of views (of lights), one for each ring, from the
 *   topmost ring down and sorted by azimuth; empty if the directions do not form rings
 *   (directions/directions.h)
 * - view_triangles, light_triangles: without rings, three indices for each triangle between the
 *   directions; empty if there are too few directions
 * - pairs: for each pair view · n_lights + light, 0 if its picture is measured, otherwise its
 *   expected error in ‰ of its own values, or -1 if it is not known yet
 * - measured, forecast: as in the event
 * - expected_error: relative error of the whole BTF, or null if it is not known yet
 * - expected_error_range: [low, high], between which the true error is with a probability of 90 %,
 *   or null
 * - later: list of [n, error], the expected error after n further shots
 * - problem: a sentence about a picture that could not be read, or empty */
char *web_material_text(const WebMaterial *material, GError **error);

/* Gets the picture of a pair, measured or predicted: height × width texels of 4 bytes, little
 * endian, in the format of partial/shared_exponent.h. back is called once. picture is NULL if error
 * is set. back owns neither picture nor error.
 *
 * back is called within this function if the picture is measured or if no session is followed.
 * Otherwise it is called later from the main loop, or by web_material_follow() or
 * web_material_free() when the session is left. */
typedef void (*WebMaterialPicture)(GBytes *picture, const GError *error, gpointer data);
void web_material_picture(WebMaterial *material, int pair, WebMaterialPicture back, gpointer data);
