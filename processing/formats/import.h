/*
 * Imports measurements of others as sessions.
 *
 * A finished BTF (rectified pictures) becomes a session with products/btf and
 * products/eigenmaps.exr as in pipeline.h, and no frames; its value "imported" names the source.
 * Values are taken as reflectance that contains n·l. Pictures are made linear by the tone curve
 * that they say; if they say none, 8-bit pictures are sRGB and others are linear. Masked pixels are
 * holes. Row 0 is at +y. The session appears complete or not at all. Any thread.
 */
#pragma once

#include "base/data_error.h"
#include "base/work.h"
#include "exr/exr.h"
#include "pictures/picture_says.h"
#include "session/session.h"

struct import_region { /* range of texels; all 0: everything */
    int x, y, width, height;
};

/* Callback: fills n_lights × height × width × 3 (R, G, B) and the number of holes (texels of 0)
 * of each light. */
typedef gboolean (*ImportView)(int view, float *ret_rgb, int *ret_holes, gpointer data,
                               GError **error);

/* Callback for the view filled last: its texels' flags (btf.h), borrowed, NULL if all are 0; may
 * add attributes to the part. */
typedef const guint8 *(*ImportLight)(int view, int light, struct exr_part *part, gpointer data);

/* Callback: one picture, of which it reads no more than the region (height × width of it) where its
 * format allows. ret_planes: R, G, B and the texels' flags (btf.h), zeroed; the flags are NULL if a
 * picture has no holes; ret_planes is NULL if only the number of holes is asked for. */
typedef gboolean (*ImportPixels)(int view, int light, const struct import_region *region,
                                 float *const *ret_planes, int *ret_holes, gpointer data,
                                 GError **error);

/* Callback: adds what is known of the filled session before it appears. */
typedef gboolean (*ImportFilled)(Session *session, gpointer data, GError **error);

struct import_material {
    const char *source; /* name of the source */
    int width, height;  /* texels */
    double texel_mm;
    struct import_region region; /* texels to import */
    int n_views, n_lights;
    const float *view_theta_deg, *view_phi_deg;   /* n_views */
    const float *light_theta_deg, *light_phi_deg; /* n_lights */
    ImportView view;
    ImportPixels picture; /* may be NULL; else instead of view, and memory holds one picture */
    ImportLight light;    /* may be NULL; region must then be everything */
    ImportFilled filled;  /* may be NULL */
    gpointer data;
    const struct session_grid
        *grid;       /* may be NULL: from the above, with the reference plane at 0 */
    const char *mdf; /* NULL, or a file that becomes products/mdf.exr as it is: of these texels */
};

struct import_result {
    int n_views, n_lights, width, height;
    gint64 holes; /* texels of all pictures */
    double eigenmaps_error;
};

/* path must not exist. Pictures with more than half holes, not counting what is masked, are an
 * error. */
gboolean import_material(const char *path, const struct import_material *material,
                         const struct work *work, struct import_result *ret, GError **error);

/* Properties that may be missing in a file. */
struct import_wish {
    double texel_mm; /* 0: as in the file, or 1 mm if it does not say */
    struct import_region region;
    enum picture_tones transfer; /* of pictures; PICTURE_TONES_UNSAID: as they say themselves */
    const char *directions; /* of import_relight(): a table (btf_directions.h); NULL: the papers' */
    GPtrArray *notes;       /* NULL, or where sentences for the user are added (g_free()): what was
                               assumed, and what looks wrong */
};

/* Imports a ".btf" of Bonn, see bonn.h. Values that do not contain n·l are multiplied by it. */
gboolean import_bonn(const char *path, const char *file, const struct import_wish *wish,
                     const struct work *work, struct import_result *ret, GError **error);

/* Imports a folder of pictures (JPEG, PNG, TIFF, EXR) whose names contain the keys tl, pl, tv, pv
 * with θ and φ of light and view in degrees, in any order, as in Bonn's UBO2003. Every view needs
 * every light; missing, duplicate and differently sized pictures are errors. */
gboolean import_pictures(const char *path, const char *folder, const struct import_wish *wish,
                         const struct work *work, struct import_result *ret, GError **error);

/* Imports a list of the lights of one view, which is seen from above (RTI). Its lines are, in
 * order: the number of pictures, which may be left out (".lp"); then for each picture its name,
 * which may be left out in all lines, and x y z of the direction to its light. Or it is a table
 * whose first line names columns that commas, semicolons or tabs separate: theta and phi in degrees
 * (or theta_rad, phi_rad), or x, y and z; and name, filename, file, image or picture, or none of
 * them. A name may be a path below the list's folder; of other paths only what follows the last
 * slash counts, and the picture lies next to the list. Without names they are the lines of
 * "filenames.txt" next to it, or all pictures there by the times in their EXIF, or, if one of them
 * says none, in the order of their names, numbers by value; names in which a camera's counter has
 * begun again are an error then. A light on the horizon is left out. Numbers may have decimal
 * commas where blanks, tabs or semicolons separate them. Blank lines and those that begin with # do
 * not count. */
gboolean import_rti(const char *path, const char *list, const struct import_wish *wish,
                    const struct work *work, struct import_result *ret, GError **error);

/* Imports the info.json of a PTM or HSH, in rgb or lrgb, that Relight made for OpenLIME, with its
 * planes (plane_0.jpg or .png, …) next to it: the material under the lights it lists, or those of
 * wish->directions if it lists none. A texel is as
 * wide as it says (pixelSizeInMM). */
gboolean import_relight(const char *path, const char *file, const struct import_wish *wish,
                        const struct work *work, struct import_result *ret, GError **error);
