/* Pictures that are taken while the turntable turns ([capture] motion = continuous): the shots of
 * lamps that share a pass, the speed of the turntable, and the time that passes take.
 *
 * A pass is a turn of the turntable ("table") in the positive direction, with one lamp lit and all
 * other axes standing. It begins before its first shot, so that the table can accelerate, settle,
 * and report its position for the first time at its final speed. The pass ends after its last shot.
 * If stopping at each angle is quicker, the shots are not in a pass, and their pass number is 0.
 *
 * The speed ω of the table is limited by two lengths at the sample's corner, which is at the
 * distance r from the axis:
 * - Blur: during an exposure of the time t, the corner moves by ω r t.
 * - Error of the pose: the position of the corner is known to within ω r · 2 δ. Here δ is the sum
 *   of the maximum error of the times of frames and the maximum error of the times of the table's
 *   positions.
 *
 * ω is chosen so that neither length exceeds [capture] blur_texels of a texel, and is then rounded
 * down to two significant digits. If the maximum speed of the table is lower, ω is that speed.
 *
 * Passes depend only on the session file, the rig's nominal geometry, its timing and the given
 * shots. They do not depend on which shots are already taken. A session that is resumed therefore
 * has the same passes, and takes the same pictures. All functions are pure, except that
 * passes_set(), passes_take_followers() and passes_put_back() change the shots. */
#pragma once

#include "rig/devices.h"
#include "session_conf.h"

/* Returns the reason why this rig cannot take the session's shots in passes; g_free(). Returns
 * NULL if the rig can, or if the session does not ask for passes. cameras are the cameras of the
 * session. */
char *passes_refused(const struct session_conf *conf, const struct rig *rig,
                     const struct rig_timing *timing, struct camera_set cameras);

struct passes_speed {
    double deg_s;
    gboolean by_axis; /* the speed is the maximum speed of the turntable */
    /* If by_axis is FALSE: TRUE if the error of the pose limits the speed, FALSE if the blur
     * does. */
    gboolean by_pose;
    double blur_texels, blur_mm; /* blur of the sample's corner at that speed */
    double pose_texels;          /* movement of the sample's corner during 2 δ at that speed */
};
struct passes_speed passes_speed(const struct session_conf *conf, const struct rig *rig,
                                 const struct rig_timing *timing, struct camera_set cameras);

/* Sets the pass of each of n shots, which are in the order of the plan and include shots that are
 * already taken. The first pass gets the number `number` + 1. Returns the number of the last pass,
 * or `number` if there is no pass. There is no pass unless the session has motion = continuous. */
int passes_set(struct session_shot *const *shots, int n, const struct session_conf *conf,
               const struct rig *rig, const struct rig_timing *timing, int number);

/* Returns the time in seconds from the end of the exposure of the shot `before` to the end of the
 * exposure of `shot` if the table passes both in one pass. Returns G_MAXDOUBLE if the two shots
 * cannot be in one pass. */
double passes_after_s(const struct session_shot *before, const struct session_shot *shot,
                      const struct session_conf *conf, const struct rig *rig,
                      const struct rig_timing *timing);

/* Prepares an array of struct session_shot for ordering. Shots that differ only in the angle of the
 * turntable must follow each other if at least some of them would be in a pass. Of each such group,
 * only the first shot stays in shots. The function returns the other shots; g_array_unref(). The
 * strings of these shots are not freed with the returned array, so the shots must be put back with
 * passes_put_back(). */
GArray *passes_take_followers(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                              const struct rig_timing *timing);
/* Copies the shots that passes_take_followers() has returned back into shots, each group behind its
 * first shot, in the order in which the table passes them. */
void passes_put_back(GArray *shots, GArray *followers, const struct rig *rig);

/* Returns turntable_deg, the angle of a shot, plus the multiple of 360° that puts the sum between
 * pass->from_deg and pass->from_deg + pass->by_deg. Returns turntable_deg itself if pass->number is
 * 0. */
double passes_at_deg(const struct session_pass *pass, double turntable_deg);

/* Returns the time in seconds until the trigger of a shot in a pass. The time is counted from the
 * end of the exposure of the shot `before` if that shot is in the same pass, otherwise from the
 * beginning of the pass. `before` may be NULL. frame_s is the time from a trigger to the end of the
 * exposure, and exposure_s is the exposure time. */
double passes_lead_s(const struct session_shot *before, const struct session_shot *shot,
                     double frame_s, double exposure_s, const struct axis_motion *table);

/* Returns the time in seconds from the end of the exposure of the last shot of a pass until the
 * table stands still and has settled. */
double passes_exit_s(const struct session_shot *shot, double exposure_s,
                     const struct axis_motion *table);
