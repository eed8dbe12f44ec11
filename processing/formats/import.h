/*
 * What others have measured, made into a session, so that everything that takes a session takes it.
 *
 * A finished BTF (pictures that lie on the texels already) becomes a session with products/btf and
 * products/eigenmaps.exr as in pipeline.h, and no frames; its value "imported" says of what. Values
 * are taken as reflectance that holds n·l; 8-bit pictures are sRGB and made linear, others are
 * linear. Row 0 is at +y. The session appears whole or not at all. Any thread.
 */
#pragma once

#include "base/data_error.h"
#include "base/work.h"
#include "exr/exr.h"
#include "session/session.h"

struct import_region { /* of texels; all 0: everything */
    int x, y, width, height;
};

/* Fills n_lights × height × width × 3 (R, G, B) and, of each light, how many texels are holes (0).
 */
typedef gboolean (*ImportView)(int view, float *ret_rgb, int *ret_holes, gpointer data,
                               GError **error);

/* Of the view that was filled last: its texels' marks (btf.h), borrowed, NULL if all are 0; and
 * more to say in the part's header. */
typedef const guint8 *(*ImportLight)(int view, int light, struct exr_part *part, gpointer data);

struct import_material {
    const char *source; /* of what it is made */
    int width, height;  /* texels */
    double texel_mm;
    struct import_region region; /* that is kept */
    int n_views, n_lights;
    const float *view_theta_deg, *view_phi_deg;   /* n_views */
    const float *light_theta_deg, *light_phi_deg; /* n_lights */
    ImportView view;
    ImportLight light; /* may be NULL; region must then be everything */
    gpointer data;
    const struct session_grid *grid; /* may be NULL: of the above, the reference plane at 0 */
    const char *mdf; /* NULL, or a file that becomes products/mdf.exr as it is: of these texels */
};

struct import_result {
    int n_views, n_lights, width, height;
    gint64 holes; /* texels of all pictures */
    double eigenmaps_error;
};

/* path must not exist. More holes than half of a picture are an error. */
gboolean import_material(const char *path, const struct import_material *material,
                         const struct work *work, struct import_result *ret, GError **error);

/* What is said of a file that does not say it itself. */
struct import_wish {
    double texel_mm; /* 0: as the file says, else 1 */
    struct import_region region;
};

/* A ".btf" of Bonn, see bonn.h. Where its values do not hold n·l they are multiplied by it. */
gboolean import_bonn(const char *path, const char *file, const struct import_wish *wish,
                     const struct work *work, struct import_result *ret, GError **error);

/* A folder of pictures (JPEG, PNG, TIFF, EXR) whose names hold the keys tl, pl, tv, pv with θ and φ
 * of light and view in degrees, in any order, as Bonn's UBO2003 has them. Every light must be there
 * for every view; what is missing, double, or of another size is an error. */
gboolean import_pictures(const char *path, const char *folder, const struct import_wish *wish,
                         const struct work *work, struct import_result *ret, GError **error);

/* A list of lights (".lp") as programs for reflectance transformation imaging have it: the number
 * of pictures, then a line a picture: its name and x y z of the direction to its light. Seen from
 * above. Names are looked for beside the list. */
gboolean import_rti(const char *path, const char *list, const struct import_wish *wish,
                    const struct work *work, struct import_result *ret, GError **error);
