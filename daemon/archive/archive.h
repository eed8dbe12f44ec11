/*
 * A session described for others: the content of its database, of its products' headers and of a
 * few of its pictures, gathered once, and written as a page (HTML, one file) or as the metadata of
 * a research object (RO-Crate 1.1). Writes nothing. Any thread.
 */
#pragma once

#include "calibration/calibration.h"
#include "session/session.h"

enum archive_verdict { ARCHIVE_PASS, ARCHIVE_WARNING, ARCHIVE_FAILURE };

/* Which calibration the products of a session were made with. */
struct archive_calibration {
    char *where;    /* "nominal", or the path of its file */
    char *said;     /* one line for people */
    gboolean own;   /* it is the one that the session was captured with */
    gboolean mixed; /* some products may be of another, since their processing was not finished */
};

/* Returns that calibration, or NULL with an error. ret is to be cleared. */
struct calibration *archive_calibration(Session *session, struct archive_calibration *ret,
                                        GError **error);
void archive_calibration_clear(struct archive_calibration *with);

struct archive_check {
    enum archive_verdict verdict;
    char *name; /* "shots" */
    char *said; /* a sentence with the figure, and what to do */
};

/* The views of one elevation, as the headers of products/btf and products/mdf.exr say it. Shares
 * are 0 … 1, NAN where nothing is known. */
struct archive_ring {
    double theta_deg;
    int views, pictures;
    double holes, bounds, shorter, predicted; /* of the BTF's texels */
    double sigma;                             /* median over pictures of σ / value */
    double measured, supplied; /* of the MDF's texels: by the view itself, by other views */
};

struct archive_picture {
    char *caption;
    GBytes *png; /* sRGB, 8 bits */
};

struct archive {
    char *path, *name, *program, *created; /* created: ISO 8601, UTC */
    /* The keys sample, operator, notes and license of [session]; "" where they are not given. */
    char *sample, *operator_name, *notes, *license;
    char *state;    /* "done", "unfinished", "paused", "aborted" */
    char *imported; /* what it was imported from, or NULL */
    char *chosen;   /* exposures that were auto, or NULL */
    struct session_grid grid;
    int views, lights, lasers;
    int planned, done, skipped; /* shots */
    int unneeded; /* shots that [lasers] stop = covered and [lights] sampling = adaptive have left
                     out; skipped does not count them */
    int frames, retakes;
    gint64 frame_bytes, product_bytes;
    double predicted_s, clock_s, processing_s, predicted_bytes; /* NAN: not known */
    struct calibration *calibration; /* of the products; NULL: the session has none */
    struct archive_calibration calibrated;
    GPtrArray *devices;  /* of struct archive_device, in the rig file's order */
    GPtrArray *checks;   /* of struct archive_check */
    GArray *rings;       /* of struct archive_ring, by θ */
    GPtrArray *pictures; /* of struct archive_picture */
    GPtrArray *products; /* of struct session_product */
    GPtrArray *events;   /* of struct session_event */
};

/* A section of the rig file. */
struct archive_device {
    char *section; /* "camera top" */
    char *driver;  /* "" for sections without one */
    char *address; /* the value of device, serial, address or host, whichever it has; or "" */
};

/* verify: also hashes all frames and products, and lists the files that differ. Reports progress in
 * the stages "verify" and "read". */
struct archive *archive_read(const char *path, gboolean verify, const struct work *work,
                             GError **error);
void archive_free(struct archive *archive); /* NULL is ignored */
typedef struct archive Archive;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Archive, archive_free)

void archive_add_check(struct archive *archive, enum archive_verdict verdict, const char *name,
                       const char *format, ...) G_GNUC_PRINTF(4, 5);
/* The worst of all checks. */
enum archive_verdict archive_verdict(const struct archive *archive);
const char *archive_verdict_name(enum archive_verdict verdict); /* "pass", "warning", "failure" */

/* Adds small pictures: what was photographed, the BTF from three elevations under three lights, and
 * the surface as the MDF of the steepest view has it. Missing ones are left out. */
gboolean archive_add_pictures(struct archive *archive, const struct work *work, GError **error);

/* A page without references to other files. history: an <svg> element, or NULL. g_free(). */
char *archive_page(const struct archive *archive, const char *history);

/* The text of ro-crate-metadata.json (RO-Crate 1.1, JSON-LD); g_free(). */
char *archive_crate(const struct archive *archive);
