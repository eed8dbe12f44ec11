#include "btf/btf.h"
#include "plan_private.h"

#define RAD(deg)          ((deg) * (G_PI / 180))
#define LARGEST_SHIFT_DEG 20
#define SHIFT_STEP_UDEG   (UDEG / 10)

/* Returns the distance of a ball of radius body_mm from the cone between an eye and the disc of
 * radius_mm around the origin. It is negative if the ball reaches into the cone, and G_MAXDOUBLE if
 * the ball is behind the disc. The ball is nearer to the origin than the eye. */
static double cone_clearance_mm(struct vec3 eye, struct vec3 body, double radius_mm,
                                double body_mm) {
    double distance = vec3_length(eye);
    struct vec3 towards = vec3_scale(eye, 1 / distance);
    double along = vec3_dot(body, towards);

    if (along <= 0)
        return G_MAXDOUBLE;
    double apart = vec3_length(vec3_sub(body, vec3_scale(towards, along)));
    return apart - body_mm - radius_mm * (1 - along / distance);
}

/* Returns whether a light is in a camera's picture, or the camera is in its light. Lamps, lasers
 * and cameras are assumed to be as wide as the arc that carries the lights. */
static gboolean hides(const struct rig *rig, struct vec3 eye, struct vec3 light, double radius_mm) {
    gboolean nearer = vec3_length(light) < vec3_length(eye);

    return cone_clearance_mm(nearer ? eye : light, nearer ? light : eye, radius_mm,
                             rig->arc_width_mm / 2) < 0;
}

static gboolean is_blocked(const struct rig *rig, int camera, double arc_rad, double radius_mm,
                           const GArray *lights) {
    struct vec3 eye = rig_camera_centre_mm(&rig->cameras[camera]);

    if (rig_arc_clearance_mm(rig, camera, arc_rad, radius_mm) < 0)
        return TRUE;
    for (guint i = 0; i < lights->len; i++) {
        struct vec3 light = rig_turn(g_array_index(lights, struct vec3, i), arc_rad);
        if (hides(rig, eye, light, radius_mm))
            return TRUE;
    }
    return FALSE;
}

struct camera_set plan_blocked(const struct rig *rig, struct camera_set cameras, double arc_deg,
                               double radius_mm, const GArray *lights) {
    struct camera_set blocked = {{0}};

    for (int c = camera_set_next(cameras, -1); c >= 0; c = camera_set_next(cameras, c))
        if (is_blocked(rig, c, RAD(arc_deg), radius_mm, lights))
            camera_set_add(&blocked, c);
    return blocked;
}

struct camera_set plan_blocked_by(const struct rig *rig, struct camera_set cameras,
                                  struct vec3 light_mm, double radius_mm) {
    struct camera_set blocked = {{0}};

    for (int c = camera_set_next(cameras, -1); c >= 0; c = camera_set_next(cameras, c))
        if (hides(rig, rig_camera_centre_mm(&rig->cameras[c]), light_mm, radius_mm))
            camera_set_add(&blocked, c);
    return blocked;
}

gboolean plan_shift(const struct rig *rig, const struct axis_motion *arc, struct camera_set cameras,
                    gint64 arc_udeg, double radius_mm, const GArray *lights,
                    gint64 *ret_shift_udeg) {
    for (gint64 shift = SHIFT_STEP_UDEG; shift <= LARGEST_SHIFT_DEG * UDEG;
         shift += SHIFT_STEP_UDEG) {
        for (int sign = 1; sign >= -1; sign -= 2) {
            gint64 reached;
            double arc_deg = (double)(arc_udeg + sign * shift) / UDEG;
            if (!plan_axis_reach(arc, arc_udeg + sign * shift, &reached) ||
                !camera_set_is_empty(plan_blocked(rig, cameras, arc_deg, radius_mm, lights)))
                continue;
            *ret_shift_udeg = sign * shift;
            return TRUE;
        }
    }
    return FALSE;
}

char *plan_missing(const struct session_plan *plan) {
    int views = 0, pictures = 0;
    g_autoptr(GPtrArray) skipped = g_ptr_array_new();
    for (int k = 0; k < plan->n_shots; k++)
        if (plan->shots[k].kind == SHOT_LAMP && plan->shots[k].state == SHOT_SKIPPED)
            g_ptr_array_add(skipped, (gpointer)&plan->shots[k]);
    for (int i = 0; i < plan->n_views; i++) {
        const struct session_direction *view = &plan->views[i];
        int n = 0;
        for (guint k = 0; k < skipped->len; k++) {
            const struct session_shot *shot = skipped->pdata[k];
            n += shot->turntable_deg == view->turntable_deg &&
                 camera_set_has(shot->cameras, view->device);
        }
        if (n > BTF_MAX_MISSING * plan->n_lights)
            views++;
        else
            pictures += n;
    }
    if (views > 0)
        return g_strdup_printf(
            "%d of %d views miss more than %g %% of their lights: these views will have no BTF (a "
            "session for calibration needs none); another offset_deg of [lights] may help",
            views, plan->n_views, 100 * BTF_MAX_MISSING);
    return pictures > 0
               ? g_strdup_printf("%d pictures of the BTF will be predicted from those of other "
                                 "lights; another offset_deg of [lights] may help",
                                 pictures)
               : NULL;
}
