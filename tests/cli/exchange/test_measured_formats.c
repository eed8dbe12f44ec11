/* The commands that import and export files of measured BRDFs and RTI: other commands can use the
 * sessions. If something is wrong, there is an error, and no file is left behind. */
#include "formats/brdf/rgl.h"
#include "formats/reflectance/abrdf.h"
#include "lib/folder.h"
#include "lib/process.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

static void satin(const float light[3], const float view[3], float ret[3],
                  gpointer data G_GNUC_UNUSED) {
    const float x = (light[0] + view[0]) / (light[2] + view[2]);
    const float y = (light[1] + view[1]) / (light[2] + view[2]);
    const float lobe = 0.15F / (1 + 4 * (x * x + y * y));
    ret[0] = 0.12F + lobe;
    ret[1] = 0.08F + lobe;
    ret[2] = 0.04F + lobe;
}

/* satin.bsdf, and small tables of directions. */
static void make_files(void) {
    static const struct work quietly = {0};
    static const struct rgl_options options = {.isotropic = TRUE, .n_turns = 1};
    g_autofree char *path = in_folder("satin.bsdf"), *table = in_folder("few.csv");
    g_autoptr(GString) text = g_string_new("of,theta_deg,phi_deg\nboth,0,0\n");
    struct rgl_result result;
    g_assert_true(rgl_write(path, satin, NULL, &options, &quietly, &result, NULL));
    for (int i = 0; i < 18; i++)
        g_string_append_printf(text, "both,%d,%d\n", 30 + 20 * (i % 3), 20 * i);
    g_assert_true(g_file_set_contents(table, text->str, -1, NULL));
    g_autofree char *line = in_folder("line.csv");
    g_assert_true(g_file_set_contents(
        line, "of,theta_deg,phi_deg\nview,0,0\nlight,0,0\nlight,30,0\nlight,60,0\n", -1, NULL));
}

/* How many files lie in the folder: what fails leaves none. */
static int count_files(void) {
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    int n = 0;
    while (g_dir_read_name(dir))
        n++;
    return n;
}

static void says(int code, const char *arguments, const char *words) {
    g_autofree char *text = process_mesorig(code, "%s", arguments);
    assert_has(text, words);
}

static double number_of(const char *json, const char *name) {
    g_autofree char *key = g_strdup_printf("\"%s\": ", name);
    g_autofree char *tight = g_strdup_printf("\"%s\":", name);
    const char *at = strstr(json, key) ? strstr(json, key) : strstr(json, tight);
    g_assert_nonnull(at);
    return g_ascii_strtod(strchr(at, ':') + 1, NULL);
}

/* abrdf_evaluate_both() gives what abrdf_evaluate() gives for each order. */
static void check_both_orders(void) {
    static const struct work quietly = {0};
    static const struct import_region whole = {0};
    static const float a[3] = {0.6F, 0, 0.8F}, b[3] = {-0.36F, 0.48F, 0.8F}, c[3] = {0, 0, 1};
    static const float *const pairs[][2] = {{a, b}, {b, c}, {c, a}};
    g_autofree char *path = in_folder("satin.session");
    g_autoptr(Abrdf) abrdf = abrdf_read(path, &whole, &quietly, NULL);
    g_assert_nonnull(abrdf);
    for (gsize i = 0; i < G_N_ELEMENTS(pairs); i++) {
        float both[2][3], one[3], other[3];
        abrdf_evaluate_both(pairs[i][0], pairs[i][1], both, abrdf);
        abrdf_evaluate(pairs[i][0], pairs[i][1], one, abrdf);
        abrdf_evaluate(pairs[i][1], pairs[i][0], other, abrdf);
        g_assert_cmpmem(both[0], sizeof one, one, sizeof one);
        g_assert_cmpmem(both[1], sizeof other, other, sizeof other);
        g_assert_true(memcmp(one, other, sizeof one) !=
                      0); /* the interpolation is not reciprocal */
    }
}

static void check_round(void) {
    says(0, "import bsdf satin.bsdf -o satin.session -d few.csv --texels 4",
         "19 views × 19 lights of 4 × 4 texels");
    says(0, "info satin.session", "satin.bsdf");
    says(0, "check satin.session", "");
    check_both_orders();
    says(0, "compress satin.session --components 3", "");
    g_autofree char *out =
        process_mesorig(0, "export bsdf satin.session --isotropic -o again.bsdf --json");
    g_assert_cmpfloat(number_of(out, "error"), <, 0.02);
    g_assert_cmpfloat(number_of(out, "lowest_deg"), ==, 70);
    g_assert_cmpint((int)number_of(out, "width"), ==, 4);
    says(0, "export bsdf satin.session --texel 3,3 --isotropic -o texel.bsdf",
         "19 views × 19 lights of one texel");
    says(0, "import bsdf again.bsdf -o again.session -d few.csv --texels 4", "19 views");
    g_autofree char *compared = process_mesorig(0, "compare satin.session again.session --json");
    /* Nineteen directions, 20° apart, are all that the file was interpolated from: 3.5 %. */
    g_assert_cmpfloat(number_of(compared, "error"), <, 0.05);

    /* A compressed material as well. */
    says(0, "export bsdf satin.session/products/eigenmaps.exr --isotropic -o maps.bsdf",
         "the mean of 4 × 4 texels");

    says(0, "export ptm satin.session -o satin.ptm", "view 0 (0° from the normal)");
    says(0, "export ptm satin.session -o rgb.ptm --format rgb --view 3", "view 3 (70°");
    says(0, "export relight satin.session -o web", "under 19 lights");
    says(0, "import ptm satin.ptm -o ptm.session -d few.csv", "1 view × 19 lights");
    says(0, "import relight web/info.json -o web.session", "1 view × 19 lights");
    says(0, "import relight web -o folder.session", "1 view × 19 lights"); /* the folder itself */
    says(0, "import bsdf satin.bsdf -o wide.session -d few.csv --texels 16", "16 × 16 texels");
    says(0, "synthesize wide.session --size 32x24 -m quilting -o index.exr",
         "by quilting, 32 × 24 texels in 3 mip levels, of 16 × 16");
    says(0, "info index.exr",
         "index map of 32 × 24 texels (32 × 24 mm), by quilting, of a sample of 16 × 16; 3 mip");
    says(1, "compare wide.session satin.session", "they have different numbers of texels");
}

static void check_wrong(void) {
    static const struct {
        int code;
        const char *arguments, *words;
    } wrong[] = {
        {2, "import", "Import a BRDF of the RGL"},
        {2, "import bsd satin.bsdf", "did you mean “bsdf”?"},
        {2, "import bsdf satin.bsdf", "give -o DIR.session"},
        {2, "import bsdf satin.bsdf -o x.session --texels 0", "--texels=0 is out of range"},
        {2, "import utia satin.bsdf -o x.session --coding gamma", "choose from: linear, srgb"},
        {1, "import bsdf satin.bsdf -o satin.session", "exists already"},
        {1, "import merl satin.bsdf -o x.session", "90, 90, 180"},
        {1, "import utia satin.bsdf -o x.session", "satin.bsdf"},
        {1, "import ptm satin.bsdf -o x.session", "neither a .ptm"},
        {1, "import bsdf satin.ptm -o x.session", "not a tensor file"},
        {1, "import bsdf no.bsdf -o x.session", "no.bsdf"},
        {1, "import bsdf satin.bsdf -o x.session -d no.csv", "no.csv"},
        {1, "export bsdf satin.session -o x.merl", "ends in .bsdf"},
        {1, "export merl satin.session -o x.bsdf", "ends in .binary"},
        {1, "export bsdf satin.session", "give -o FILE"},
        {1, "export bsdf satin.session -o no/x.bsdf", "no/x.bsdf: cannot be written"},
        {1, "export bsdf satin.session -o x.bsdf --region 3,3,2,2",
         "does not lie within the 4 × 4"},
        {2, "export bsdf satin.session -o x.bsdf --region 3,3", "X,Y,WIDTH,HEIGHT"},
        {2, "export bsdf satin.session -o x.bsdf --texel 1", "X,Y"},
        {2, "export bsdf satin.session -o x.bsdf --texel 1,1 --region 0,0,1,1",
         "give --region or --texel, not both"},
        {1, "export bsdf ptm.session -o x.bsdf", "1 views and 19 lights"},
        {1, "export bsdf few.csv -o x.bsdf", "few.csv"},
        {1, "export bsdf . -o x.bsdf", "."},
        {1, "export ptm satin.session -o x.ptm --view 19", "views 0 to 18"},
        {2, "export ptm satin.session -o x.ptm --format cmyk", "choose from: lrgb, rgb"},
        {1, "export relight satin.session -o web", "exists already"},
        {1, "export bsdf satin.session -o satin.bsdf", "satin.bsdf exists already"},
        {1, "export ptm line.session -o x.ptm", "do not determine the six terms"},
    };
    says(0, "import bsdf satin.bsdf -o line.session -d line.csv", "1 view × 3 lights");
    const int before = count_files();
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        says(wrong[i].code, wrong[i].arguments, wrong[i].words);
        g_assert_cmpint(count_files(), ==, before);
    }
}

/* One test: what is wrong is tried on the sessions that were made. */
TEST(commands) {
    check_round();
    check_wrong();
}

BEFORE_TESTS {
    folder_make();
    g_assert_cmpint(g_chdir(folder), ==, 0);
    make_files();
}

AFTER_TESTS {
    folder_remove();
}
