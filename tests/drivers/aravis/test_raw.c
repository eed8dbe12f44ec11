/* Cameras with the names of several makers: every function that alters pictures is switched off,
 * and a function that cannot be switched off is reported. While anything is on, the virtual camera
 * squares brightness. */
#include "lib/gige_rig.h"
#include "lib/ok.h"
#include "lib/painted.h"
#include "lib/test.h"

#include <string.h>

struct style {
    const char *file;                  /* in cameras/ */
    guint32 first[VIRTUAL_PROCESSING]; /* registers as delivered: everything is on */
    guint32 neutral[VIRTUAL_PROCESSING];
    const char *again; /* a setting of the rig file that turns something on again */
};

/* Selectors (LUTSelector, …) have to be left where they were. */
static const struct style styles[] = {
    {"standard",
     {1, 45, 2, 1, 0, 1, 1, 1, 1, 1, 0, 1500, 700, 2, 1, 1},
     {0, 45, 2, 0, 0, 0, 0, 1, 0, 0, 0, 1000, 1000, 0, 0, 0},
     "GammaEnable=true"},
    {"prosilica",
     {45, (guint32)-3, 130, 1, 1, 1, 0, 2, 1, 0, 1, 120, 300, 2},
     {100, 0, 100, 1, 0, 0, 0, 0, 0, 1, 1, 100, 100, 0},
     "Gamma=0.5"},
    {"point-grey",
     {1, 1, 1, 2000, 1300, 1, 2, 1, 1, 1, 1},
     {0, 0, 1, 2000, 1000, 0, 0, 0, 0, 0, 0},
     "pgrHDRModeEnabled=true"},
    {"basler",
     {1, 1, 80, 2, 0, 50, (guint32)-50, 100, 150, 0, 1, 1, 1, 1, 1},
     {1, 0, 80, 0, 2, 50, 0, 0, 150, 1, 0, 0, 0, 0, 0},
     "DigitalShift=1"},
    {"others",
     {1, 1, 1, 1, 1, 1, 1, 2, 1, 1, 1, 0, 1, 2},
     {0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0},
     "HotPixelCorrection=On"},
};

struct styled {
    struct virtual_processing processing;
    char *xml;
    struct eye eye;
};

static void styled_begin(struct styled *styled, const char *file, const guint32 *first,
                         const guint32 *neutral, guint fixed, gboolean grey_too) {
    g_autofree char *path =
        g_strdup_printf(SOURCE_DIR "/tests/drivers/aravis/cameras/%s.xml", file);
    *styled = (struct styled){0};
    ok(g_file_get_contents(path, &styled->xml, NULL, ERR));
    styled->processing.xml = styled->xml;
    styled->processing.fixed = fixed;
    styled->processing.grey_too = grey_too;
    memcpy(styled->processing.first, first, sizeof styled->processing.first);
    memcpy(styled->processing.neutral, neutral, sizeof styled->processing.neutral);
    struct virtual_camera_options options = {.serial = "STYLED",
                                             .width = PAINTED_WIDTH,
                                             .height = PAINTED_HEIGHT,
                                             .bits = 12,
                                             .cfa = CFA_RGGB,
                                             .picture = painted_paint,
                                             .processing = &styled->processing};
    styled->eye.device = ok(virtual_gige_new(&options, NULL, ERR));
}

static void styled_end(struct styled *styled) {
    eye_end(&styled->eye, NULL);
    g_free(styled->xml);
}

/* A picture of a colour camera in Mono is computed from several pixels: it is taken only from one
 * that says that it has no colour filters. */
TEST(grey_or_coloured) {
    static const struct {
        const struct style *style;
        enum cfa cfa;
    } cases[] = {{&styles[0], CFA_RGGB}, {&styles[1], CFA_MONO}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        const struct style *style = cases[i].style;
        struct styled styled;
        styled_begin(&styled, style->file, style->first, style->neutral, 0, TRUE);
        eye_start(&styled.eye, "", 1000);
        g_assert_cmpint(styled.eye.camera->format.cfa, ==, (int)cases[i].cfa);
        g_assert_cmpint(styled.eye.camera->format.bits, ==, 12);
        styled_end(&styled);
    }
}

/* Opens it without a warning, which would end the test; then all registers are neutral, and the
 * picture is the sensor's. Switched on again by the rig file, it is left on, without a warning. */
static void switched_off(gconstpointer data) {
    const struct style *style = data;
    struct styled styled;
    struct virtual_camera_state state;
    styled_begin(&styled, style->file, style->first, style->neutral, 0, FALSE);
    virtual_gige_state(styled.eye.device, &state);
    g_assert_cmpuint(state.processing, !=, 0);
    eye_start(&styled.eye, "pixel_format = BayerRG12p", 1000);
    virtual_gige_state(styled.eye.device, &state);
    g_assert_cmphex(state.processing, ==, 0);
    g_assert_cmpint(eye_shoot(&styled.eye, 1), ==, CAMERA_FRAME);
    painted_assert(styled.eye.frame, 0, 0, 0);
    guint16 sample = styled.eye.frame->pixels[100];
    eye_close(&styled.eye);

    g_autofree char *keys =
        g_strdup_printf("pixel_format = BayerRG12p\nfeatures = %s", style->again);
    eye_start(&styled.eye, keys, 1000);
    virtual_gige_state(styled.eye.device, &state);
    g_assert_cmphex(state.processing, !=, 0);
    g_assert_cmpint(eye_shoot(&styled.eye, 1), ==, CAMERA_FRAME);
    g_assert_cmpuint(styled.eye.frame->pixels[100], !=, sample);
    styled_end(&styled);
}

static GLogWriterOutput print_warning(GLogLevelFlags level, const GLogField *fields, gsize n,
                                      gpointer data) {
    for (gsize i = 0; i < n; i++)
        if (level == G_LOG_LEVEL_WARNING && strcmp(fields[i].key, "MESSAGE") == 0)
            g_print("# %s\n", (const char *)fields[i].value);
    return G_LOG_WRITER_HANDLED;
}

/* A range without 1, a register that can only be read, one that keeps its value, a choice without
 * Off: each is reported with feature, value, cause and effect. */
TEST(stubborn) {
    static const guint32 first[VIRTUAL_PROCESSING] = {45, 1, 1, 1};
    static const guint32 neutral[VIRTUAL_PROCESSING] = {100, 0, 0, 9};
    static const char *const said[] = {
        "*# camera eye: gamma cannot be switched off (Gamma = 0.45: its range, 0.4 to 0.9, does "
        "not "
        "contain 1); "
        "values are not proportional to the light; switch it off with the maker's program*",
        "*# camera eye: lookup table cannot be switched off (LUTEnable = true: it can only be "
        "read); "
        "values are not proportional to the light; *",
        "*# camera eye: sharpening cannot be switched off (SharpeningEnable = true: it does not "
        "keep the value that was set); a value depends on the light at neighbouring pixels*",
        "*# camera eye: colour transformation cannot be switched off (ColorTransformationMode = "
        "Temp6500K: it has no choice \"Off\"); a value depends on the light of other colours*",
    };
    if (g_test_subprocess()) {
        struct styled styled;
        g_log_set_writer_func(print_warning, NULL, NULL);
        styled_begin(&styled, "stubborn", first, neutral, 1 << 2, FALSE);
        eye_start(&styled.eye, "", 1000);
        styled_end(&styled);
        return;
    }
    g_test_trap_subprocess(NULL, 20 * G_USEC_PER_SEC, 0);
    g_test_trap_assert_passed();
    for (gsize i = 0; i < G_N_ELEMENTS(said); i++)
        g_test_trap_assert_stdout(said[i]);
}

/* A camera that changes values from frame to frame cannot be measured with. */
TEST(unsteady) {
    static const guint32 first[VIRTUAL_PROCESSING] = {1}, neutral[VIRTUAL_PROCESSING] = {9};
    struct styled styled;
    GError *error = NULL;
    styled_begin(&styled, "unsteady", first, neutral, 0, FALSE);
    g_assert_false(eye_open(&styled.eye, "", &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED);
    g_assert_nonnull(
        strstr(error->message,
               "camera eye: automatic gain cannot be switched off (GainAuto = Continuous: it has "
               "no choice \"Off\"); the same light gives different values from frame to frame; "));
    g_clear_error(&error);
    styled_end(&styled);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(styles); i++) {
        g_autofree char *path = g_strdup_printf("/raw/%s", styles[i].file);
        g_test_add_data_func(path, &styles[i], switched_off);
    }
}
