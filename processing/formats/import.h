/*
 * Imports measurements of other laboratories as sessions.
 *
 * A finished BTF (rectified pictures) becomes a session with products/btf and
 * products/eigenmaps.exr as in pipeline.h. The session has no frames. Its value "imported" names
 * the source. Pictures are made linear by the tone curve that their files state. If a file states
 * none, 8-bit pictures are sRGB and other pictures are linear. Values are taken as reflectance that
 * contains n·l. Masked pixels are holes. Row 0 is at +y. The session appears complete or not at
 * all. Any thread.
 */
#pragma once

#include "base/data_error.h"
#include "base/work.h"
#include "exr/exr.h"
#include "pictures/picture_says.h"
#include "session/session.h"

struct import_region { /* range of texels; if width and height are 0, all texels */
    int x, y, width, height;
};

/* Callback that reads one view. It fills ret_rgb, n_lights × height × width × 3 (R, G, B), and
 * ret_holes, the number of holes of each light. A hole is a texel whose values are 0. */
typedef gboolean (*ImportView)(int view, float *ret_rgb, int *ret_holes, gpointer data,
                               GError **error);

/* Callback for a picture of the view that was read last. Returns the flags of the picture's texels
 * (btf.h), owned by the callback. Returns NULL if no texel has a flag, or if holes are the only
 * flags and ImportPixels gives them. The callback may add attributes to the part. */
typedef const guint8 *(*ImportLight)(int view, int light, struct exr_part *part, gpointer data);

/* Callback that reads one picture. If the file format allows, the callback reads only the region.
 * ret_planes are four planes of height × width that contain zeros: R, G, B and the flags of the
 * texels (btf.h). The plane of flags is NULL if the picture has no flags: it has no holes, or
 * black_holes of struct import_material is TRUE. *ret_holes receives the number of holes.
 * ret_planes is NULL if the caller wants only the number of holes. */
typedef gboolean (*ImportPixels)(int view, int light, const struct import_region *region,
                                 float *const *ret_planes, int *ret_holes, gpointer data,
                                 GError **error);

/* Callback that adds values to the filled session before the session appears. */
typedef gboolean (*ImportFilled)(Session *session, gpointer data, GError **error);

struct import_material {
    const char *source; /* name of the source */
    int width, height;  /* texels */
    double texel_mm;
    struct import_region region; /* the texels to import */
    int n_views, n_lights;
    const float *view_theta_deg, *view_phi_deg;   /* n_views */
    const float *light_theta_deg, *light_phi_deg; /* n_lights */
    ImportView view;
    /* NULL, or called instead of `view`, so that only one picture is in memory */
    ImportPixels picture;
    /* NULL, or called for the flags of each picture. If it returns flags, region must contain all
     * texels of the material. */
    ImportLight light;
    ImportFilled filled; /* NULL is allowed */
    gpointer data;
    /* grid of the session; NULL means a grid of the imported texels, with the reference plane at z
     * = 0 */
    const struct session_grid *grid;
    /* NULL, or a file that is copied to products/mdf.exr. The file must have the texels of this
     * material. */
    const char *mdf;
    /* Number of views that are written together, or 0. If it is above 0, `load` is called once for
     * the views first … first + n − 1. Then `picture` is called for these views from several
     * threads. Progress is reported when all these views are written. */
    int n_together;
    gboolean (*load)(int first, int n, gpointer data, GError **error);
    gboolean black_holes; /* with `picture`: texels without values are black and have no flags */
};

struct import_result {
    int n_views, n_lights, width, height;
    gint64 holes; /* number of texels without a value in all pictures together */
    /* RMS error of products/eigenmaps.exr relative to the RMS of the BTF; 0 for a single view */
    double eigenmaps_error;
};

/* Imports a material. path must not exist. If `picture` is NULL or black_holes is TRUE, it is an
 * error if more than half of the texels of a picture are holes. Otherwise the callback `picture`
 * decides which pictures have too many holes. The progress stages are "import" and "eigenmaps". */
gboolean import_material(const char *path, const struct import_material *material,
                         const struct work *work, struct import_result *ret, GError **error);

/* Properties that a file may lack, and what to import. */
struct import_wish {
    /* width of a texel; 0 means the width in the file, or 1 mm if the file states none */
    double texel_mm;
    struct import_region region;
    /* tone curve of pictures; PICTURE_TONES_UNSAID means the tone curve that each file states */
    enum picture_tones transfer;
    /* for import_relight(): path of a table of directions (btf_directions.h); NULL means the 81
     * directions of the papers */
    const char *directions;
    /* for import_rti(), with a list without positions: distance of all lamps from the middle of the
     * imported texels; 0 means that the lamps are far away */
    double lamp_mm;
    /* NULL, or receives sentences for the user (g_free()): assumptions, and values that look
     * wrong */
    GPtrArray *notes;
};

/* Imports a ".btf" of Bonn, see bonn.h. Values that do not contain n·l are multiplied by it. */
gboolean import_bonn(const char *path, const char *file, const struct import_wish *wish,
                     const struct work *work, struct import_result *ret, GError **error);

/* Imports a folder of pictures (JPEG, PNG, TIFF, EXR). Names of pictures contain the keys tl, pl,
 * tv and pv, in any order, with θ and φ of light and view in degrees, as in Bonn's UBO2003. Every
 * view needs every light. Missing or duplicate pictures, and pictures of different sizes, are
 * errors. */
gboolean import_pictures(const char *path, const char *folder, const struct import_wish *wish,
                         const struct work *work, struct import_result *ret, GError **error);

/* Imports the pictures of one view from above (RTI) by a list of their lights. The list has one of
 * two forms.
 *
 * Lines (".lp"): first the number of pictures, which is optional. Then, for each picture, its name
 * and x y z of the direction to its light. The name may be missing if it is missing in all lines.
 *
 * A table. Its columns are separated by commas, semicolons or tabs, and its first line names them:
 * theta and phi in degrees (or theta_rad and phi_rad), or x, y and z, or x_mm, y_mm and z_mm. A
 * column with the name of the picture is optional; it is called name, filename, file, image or
 * picture.
 *
 * x_mm, y_mm and z_mm are the position of a lamp near the sample, from the middle of the imported
 * texels. Each lamp aims at this middle. A column exponent is the n of cos^n, by which the lamp's
 * light falls with the angle from its aim; the default is 0. The value of a texel is divided by the
 * irradiance of the lamp at the texel, on a plane that faces the lamp. This irradiance is relative
 * to the mean over all lamps of the irradiance in the middle. Lamps are taken as equally bright.
 * The session then has the positions of the lamps (pipeline.h). The same is done for a list of
 * directions if wish->lamp_mm is set.
 *
 * A name may be a path below the list's folder. Of other paths only the part after the last slash
 * counts, and the picture lies next to the list.
 *
 * If the list has no names, the lines of the file "filenames.txt" next to the list are the names.
 * If that file does not exist, all pictures next to the list are taken in the order of the times in
 * their EXIF data. If a picture has no such time, they are taken in the order of their names, with
 * numbers compared by value. With the order of names, it is an error if the counter of a camera has
 * begun again within the names.
 *
 * A picture whose light is on the horizon is left out. Numbers may have decimal commas if blanks,
 * tabs or semicolons separate the numbers. Blank lines and lines that begin with # are ignored. */
gboolean import_rti(const char *path, const char *list, const struct import_wish *wish,
                    const struct work *work, struct import_result *ret, GError **error);

/* Imports the info.json of a PTM or HSH, in rgb or lrgb, that Relight made for OpenLIME. Its planes
 * (plane_0.jpg or .png, …) must be next to it. The material is evaluated under the lights that
 * info.json lists. If it lists none, wish->directions is used. The size of a texel is
 * pixelSizeInMM. */
gboolean import_relight(const char *path, const char *file, const struct import_wish *wish,
                        const struct work *work, struct import_result *ret, GError **error);
