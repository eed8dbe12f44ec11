/* This module keeps the results of `mesorig test`, and makes its report: a page that a stranger can
 * mail. Only the main thread may call the functions. */
#pragma once

#include "drivers/frame.h"
#include "picture_report.h"

/* A move of an axis. */
struct test_move {
    double target_deg, reached_deg, seconds;
    gboolean homes; /* the target is the reference of the axis */
};

/* The test of a device. */
struct test_result {
    char *class_name, *name, *driver;
    gboolean good;
    char *said; /* a sentence with figures, or the error and what to do about it */
    double seconds;
    GArray *moves; /* moves of an axis, as struct test_move */
    /* These members are only for a light. on_s and off_s are the times in seconds until the device
     * has confirmed "on" and "off", or NAN if it has not.
     *
     * rise_dn is the largest rise of any camera's picture, in DN, when the light is on. For a lamp
     * it is the rise of the mean, and for a laser that of the brightest pixel. It is NAN if no
     * camera took a picture. */
    double on_s, off_s, rise_dn;
    const char *confirmed; /* what a confirmed command of the driver means; a string constant */
};

/* A picture of a camera. */
struct test_picture {
    char *camera, *light; /* light that was on, or NULL */
    Frame *frame;
    struct picture_values report;
    double noise_dn; /* RMS of a pixel in the dark, from two pictures; NAN if it is not known */
};

struct test_report {
    char *rig;           /* id of the rig */
    GPtrArray *results;  /* of struct test_result */
    GPtrArray *pictures; /* of struct test_picture */
    char *recording;     /* text of the recording */
    gboolean failed;     /* the rig could not be opened; the recording says why */
};

void test_report_init(struct test_report *report);
void test_report_clear(struct test_report *report);

/* Adds a result for a device and returns it. The caller fills the other members. The names are
 * copied. The report owns the result. */
struct test_result *test_report_add(struct test_report *report, const char *class_name,
                                    const char *name, const char *driver);

/* Adds a picture of a camera, or replaces the picture that the report has of this camera. The
 * report takes a reference of the frame, and owns the returned picture. */
struct test_picture *test_report_add_picture(struct test_report *report, const char *camera,
                                             const char *light, Frame *frame);

/* Returns the RMS noise of a pixel in DN, from two pictures of the same scene. It is the standard
 * deviation of their difference, divided by √2. Returns NAN if the sizes of the pictures differ. */
double test_noise_dn(const Frame *a, const Frame *b);

/* Replaces paths and addresses of devices in the sentences of the results with "…". A path or
 * address of fewer than four bytes is not replaced. rig is the path of the rig file. If it cannot
 * be read, nothing is replaced. */
void test_report_hide_places(struct test_report *report, const char *rig);

/* Returns the page (common/page.h), which has no path, no host name and no address. Free it with
 * g_free(). */
char *test_report_page(const struct test_report *report);
