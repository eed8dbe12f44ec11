/*
 * Pictures while the turntable turns ([capture] motion = continuous): which shots of lamps are
 * taken in the same pass, how fast the table turns, and how long that takes.
 *
 * A pass is a turn of the table in the positive direction with one lamp lit and all other axes
 * standing. It begins before its first shot, where the table accelerates, settles, and tells for
 * the first time where it is at its speed, and it ends behind its last one. Shots for which that
 * takes longer than a stop at each of their angles are not in a pass: its number is 0.
 *
 * A point at the sample's corner, r from the axis, moves by ω r t while it is exposed for t. The
 * pose of a frame is known to within ω r 2 δ, δ being by how much the times of frames and of the
 * table's positions may be off, both together. The speed ω is such that neither is more than
 * [capture] blur_texels of a texel, and at most the table's own.
 *
 * Passes are a function of the session file, the rig's nominal geometry, its timing and the given
 * shots, whether these are taken or not: a session that is resumed has the same passes, and the
 * same pictures. Pure functions.
 */
#pragma once

#include "conf/session_conf.h"
#include "rig/devices.h"

/* Why this rig cannot take the session's shots so; g_free(). NULL: it can, or is not to. */
char *passes_refused(const struct session_conf *conf, const struct rig *rig,
                     const struct rig_timing *timing, guint32 cameras);

struct passes_speed {
    double deg_s;
    gboolean by_axis; /* it is the table's top speed */
    gboolean by_pose; /* what limits it otherwise: the pose's error instead of the blur */
    double blur_texels, blur_mm; /* of the sample's corner, at that speed */
    double pose_texels;          /* 2 δ */
};
struct passes_speed passes_speed(const struct session_conf *conf, const struct rig *rig,
                                 const struct rig_timing *timing, guint32 cameras);

/* Sets the pass of each of n shots, taken or not, in their order. The numbers of passes begin
 * behind number; returns the last one. Without motion = continuous no shot is in a pass. */
int passes_set(struct session_shot *const *shots, int n, const struct session_conf *conf,
               const struct rig *rig, const struct rig_timing *timing, int number);

/* From the end of a shot's exposure to that of another one that the table passes next; G_MAXDOUBLE:
 * they cannot be in one pass. */
double passes_after_s(const struct session_shot *before, const struct session_shot *shot,
                      const struct session_conf *conf, const struct rig *rig,
                      const struct rig_timing *timing);

/* For ordering shots: those that differ in the angle of the turntable alone, and of which at least
 * some would be in a pass, are to follow each other. Takes all but the first of them out of an
 * array of struct session_shot, and puts them back behind that one, as the table passes them. */
GArray *passes_take_followers(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                              const struct rig_timing *timing);
void passes_put_back(GArray *shots, GArray *followers, const struct rig *rig);

/* The angle of a shot as its pass counts: between from_deg and from_deg + by_deg. */
double passes_at_deg(const struct session_pass *pass, double turntable_deg);

/* Seconds before the trigger of a shot in a pass: since the pass began, or, if before is in the
 * same pass, since the end of before's exposure. frame_s: from a trigger to the end of its
 * exposure, which takes exposure_s. */
double passes_lead_s(const struct session_shot *before, const struct session_shot *shot,
                     double frame_s, double exposure_s, const struct axis_motion *table);

/* From the end of a shot's exposure, after which nothing more is taken in its pass, until the table
 * stands. */
double passes_exit_s(const struct session_shot *shot, double exposure_s,
                     const struct axis_motion *table);
