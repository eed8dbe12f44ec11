/* A description of a session for other people. It contains the content of the database, of the
 * headers of the products and of a few pictures. First this content is read. Then it is written as
 * a page (HTML, one file) or as the metadata of a research object (RO-Crate 1.1). The functions
 * return texts and write no files. Any thread may call them. */
#pragma once

#include "calibration/calibration.h"
#include "session/session.h"

enum archive_verdict { ARCHIVE_PASS, ARCHIVE_WARNING, ARCHIVE_FAILURE };

/* The calibration with which the products of a session were made. */
struct archive_calibration {
    char *where;  /* "nominal", or the path of its file */
    char *said;   /* the calibration in words, on one line */
    gboolean own; /* whether the session was captured with this calibration */
    /* Some products may have been made with another calibration, because processing with this one
     * was not finished. */
    gboolean mixed;
};

/* Returns the calibration of the products, or NULL with an error. Clear ret with
 * archive_calibration_clear(). */
struct calibration *archive_calibration(Session *session, struct archive_calibration *ret,
                                        GError **error);
void archive_calibration_clear(struct archive_calibration *with);

struct archive_check {
    enum archive_verdict verdict;
    char *name; /* name of what is checked, such as "shots" */
    char *said; /* a sentence with the figure, and what to do */
};

/* The views of one polar angle, from the headers of products/btf and products/mdf.exr. Shares are 0
 * … 1, or NAN if they are not known. */
struct archive_ring {
    double theta_deg;
    int views, pictures;
    /* Shares of the BTF's values:
     * - `holes`: texels that no usable pixel shows,
     * - `bounds`: lower bounds, because the camera was saturated at every exposure,
     * - `shorter`: values from only the shorter exposures,
     * - `predicted`: values that were computed from other pictures and not measured. */
    double holes, bounds, shorter, predicted;
    double sigma; /* median over pictures of σ / value */
    /* Shares of the MDF's texels: `measured` in the view itself, and `supplied` by other views. */
    double measured, supplied;
};

struct archive_picture {
    char *caption;
    GBytes *png; /* sRGB, 8 bits */
};

struct archive {
    char *path, *name, *program, *created; /* created is in ISO 8601, UTC */
    /* The keys sample, operator, notes and license of [session]; "" if a key is not given. */
    char *sample, *operator_name, *notes, *license;
    char *state;    /* "done", "unfinished", "paused", "aborted" */
    char *imported; /* where an imported session is from; NULL for a captured one */
    char *chosen;   /* the exposures that were chosen for "auto", or NULL */
    struct session_grid grid;
    int views, lights, lasers;
    int planned, done, skipped; /* numbers of shots */
    /* Number of shots that the capture has left out because of [lasers] stop = covered or [lights]
     * sampling = adaptive. These are not counted in `skipped`. */
    int unneeded;
    int frames, retakes;
    gint64 frame_bytes, product_bytes;
    double predicted_s, clock_s, processing_s, predicted_bytes; /* NAN if not known */
    struct calibration *calibration; /* calibration of the products; NULL if there is none */
    struct archive_calibration calibrated;
    GPtrArray *devices;  /* of struct archive_device, in the order of the rig file */
    GPtrArray *checks;   /* of struct archive_check */
    GArray *rings;       /* of struct archive_ring, by θ */
    GPtrArray *pictures; /* of struct archive_picture */
    GPtrArray *products; /* of struct session_product */
    GPtrArray *events;   /* of struct session_event */
};

/* A section of the rig file. */
struct archive_device {
    char *section; /* heading of the section, such as "camera top" */
    char *driver;  /* "" for sections without one */
    /* The value of the first of these keys that the section has: device, serial, address, host,
     * line. The value is "" if it has none. */
    char *address;
};

/* Reads a session. If verify is TRUE, the checksums of all frames and products are also compared,
 * and the checks list the files that differ. Reports progress in the stages "verify" and "read".
 * Returns NULL with an error on failure. */
struct archive *archive_read(const char *path, gboolean verify, const struct work *work,
                             GError **error);
void archive_free(struct archive *archive); /* NULL is ignored */
typedef struct archive Archive;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Archive, archive_free)

void archive_add_check(struct archive *archive, enum archive_verdict verdict, const char *name,
                       const char *format, ...) G_GNUC_PRINTF(4, 5);
/* Returns the worst verdict of all checks. */
enum archive_verdict archive_verdict(const struct archive *archive);
const char *archive_verdict_name(enum archive_verdict verdict); /* "pass", "warning", "failure" */

/* Adds small pictures to the description:
 * - the first lamp frame of each camera, for at most 32 cameras,
 * - the BTF from three polar angles of view under three lights,
 * - the surface according to the MDF of the steepest view.
 *
 * Missing pictures are left out. Returns FALSE with an error if the database cannot be read or if
 * the work is cancelled. */
gboolean archive_add_pictures(struct archive *archive, const struct work *work, GError **error);

/* Returns a page that needs no other files. history is an <svg> element, or NULL. Free the page
 * with g_free(). */
char *archive_page(const struct archive *archive, const char *history);

/* Returns the text of ro-crate-metadata.json (RO-Crate 1.1, JSON-LD). Free it with g_free(). */
char *archive_crate(const struct archive *archive);
