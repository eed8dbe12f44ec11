/* The marks of pixels that are NaN, saturated or known only from shorter exposures. */
#include "base/data_error.h"
#include "lib/ok.h"
#include "lib/pipeline_fixture.h"

#include "btf/btf.h"
#include "btf/btf_matrix.h"

static void one_nan(struct exr_part *part, const struct session_shot *shot) {
    if (shot->id == 2)
        part->planes[0][SIDE / 2 * SIDE + SIDE / 2] = NAN;
}

static void all_nan(struct exr_part *part, const struct session_shot *shot) {
    for (int i = 0; i < SIDE * SIDE && shot->id == 2; i++)
        part->planes[0][i] = NAN;
}

/* A pixel that is NaN makes holes, which are counted; a picture with NaN alone is refused. */
static void test_nan(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, one_nan);
    fixture_process(fixture, 2, FALSE);
    g_autofree char *path = fixture_product(fixture, "btf/view_0000.exr");
    g_autoptr(ExrPart) part = exr_read_part(path, "light_0001", NULL);
    int holes, zeros = 0;
    g_assert_true(exr_get_int(part, "mesorig.holes", &holes, NULL));
    for (int i = 0; i < TEXELS * TEXELS; i++) {
        g_assert_true(isfinite(part->planes[0][i]));
        zeros += part->planes[0][i] == 0;
    }
    g_assert_cmpint(holes, >, 0);
    g_assert_cmpint(zeros, ==, holes);
    fixture_capture(fixture, 1, 2, all_nan);
    fixture_process_fails(fixture, DATA_ERROR_INVALID, "000002");
}

static void add_channel(struct exr_part *part, const char *name) {
    part->channels = g_renew(char *, part->channels, part->n_channels + 2);
    part->planes = g_renew(float *, part->planes, part->n_channels + 1);
    part->channels[part->n_channels] = g_strdup(name);
    part->channels[part->n_channels + 1] = NULL;
    part->planes[part->n_channels++] = g_new0(float, SIDE *SIDE);
}

enum { SATURATED = 40 * SIDE + 40, BRIGHT = 55 * SIDE + 60 };

/* In shot 2 one pixel is saturated, another too bright for the longest exposure, a third NaN. */
static void all_sorts(struct exr_part *part, const struct session_shot *shot) {
    if (shot->id != 2)
        return;
    float most = 0;
    for (int i = 0; i < SIDE * SIDE; i++)
        most = MAX(most, part->planes[0][i]);
    add_channel(part, "saturated");
    part->planes[1][SATURATED] = 1;
    part->planes[0][SATURATED] = part->planes[0][BRIGHT] = 3 * most;
    part->planes[0][SIDE / 2 * SIDE + SIDE / 2] = NAN;
    exr_set_double(part, "mesorig.shorter_from", 2 * (double)most);
    exr_set_int(part, "mesorig.saturated", 1);
}

/* The texel in which the ray of a pixel of the first camera meets the plane at 5 mm. */
static int texel_at(int pixel) {
    double p[3];
    hit(&pinholes[0], pixel, 5, p);
    analytic_turn(p, -fixture_turn_deg(0) * DEGREE, p);
    return (int)floor((12 - p[1]) / 24 * TEXELS) * TEXELS + (int)floor((p[0] + 12) / 24 * TEXELS);
}

static void check_mark(const struct exr_part *part, int mark, const char *name, int pixel) {
    const float *marks = exr_part_plane(part, "mark");
    const int at = texel_at(pixel);
    int count = 0, said;
    g_assert_nonnull(marks);
    for (int i = 0; i < TEXELS * TEXELS; i++) {
        if (!((int)marks[i] & mark))
            continue;
        count++;
        g_assert_cmpint(abs(i % TEXELS - at % TEXELS), <=, 2);
        g_assert_cmpint(abs(i / TEXELS - at / TEXELS), <=, 2);
    }
    g_assert_true((int)marks[at] & mark);
    g_assert_true(exr_get_int(part, name, &said, NULL));
    g_assert_cmpint(said, ==, count);
}

/* The mark of a pixel is set in the texels that show the pixel, and in no others. */
static void test_marks(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    fixture_capture(fixture, 0, fixture->n_shots, all_sorts);
    fixture_process(fixture, 2, FALSE);
    g_autofree char *path = fixture_product(fixture, "btf/view_0000.exr");
    g_autoptr(ExrPart) part = exr_read_part(path, "light_0001", &error);
    g_assert_no_error(error);
    check_mark(part, BTF_FLAG_BOUND, "mesorig.bounds", SATURATED);
    check_mark(part, BTF_FLAG_SHORTER, "mesorig.shorter", BRIGHT);
    check_mark(part, BTF_FLAG_HOLE, "mesorig.holes", SIDE / 2 * SIDE + SIDE / 2);
    g_autoptr(ExrPart) other = exr_read_part(path, "light_0000", NULL);
    g_assert_null(exr_part_plane(other, "mark"));
    struct btf_matrix *btf = ok(btf_matrix_read(fixture->path, NULL, ERR));
    g_assert_cmpint(btf->holes, >, 0);
    g_assert_cmpint(btf->bounds, >, 0);
    g_assert_cmpint(btf->shorter, >, 0);
    for (gsize i = 0; i < TEXELS * TEXELS * btf_layout_values(&btf->layout); i++)
        g_assert_cmpfloat(btf->values[i], !=, 0);
    btf_matrix_free(btf);
}

int main(int argc, char **argv) {
    static const struct pipeline_test tests[] = {
        {"/pipeline/nan", test_nan},
        {"/pipeline/marks", test_marks},
    };
    return fixture_run_tests(argc, argv, tests, G_N_ELEMENTS(tests));
}
