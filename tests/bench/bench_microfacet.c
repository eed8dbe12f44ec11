/* Rotated microfacets (Kang & Cho 2011) on a torus of brushed metal: the time of a frame compared
 * with plain normal mapping, the costs of their Table I, and the difference between the approximate
 * and the exact rotation for different tilts of the normal. */
#include "bench.h"
#include "frame_time.h"
#include "lib/direction.h"
#include "lib/microfacet_formula.h"
#include "microfacet_parts.h"
#include "shapes/scene.h"

#include <math.h>
#include <stdio.h>

#define STEPS   17 /* of 5 degrees */
#define AZIMUTH 72
#define LIMIT   1.01 /* times plain normal mapping */

struct tilt {
    double degrees;
    double half_rms, half_worst; /* length of the difference of the half vectors */
    double ward_rms;             /* of reflectances, relative to the exact ones' RMS */
};

static double ward_at(struct vec3 n, struct vec3 h, enum method_rotation rotation) {
    static const struct microfacet ward = {
        MICROFACET_WARD, {0, 0, 0}, {1, 1, 1}, {0.1F, 0.5F}}; /* of Kang & Cho 2011, fig. 5 */
    double rgb[3];
    microfacet_evaluate(&ward, n, h, h, rotation, rgb); /* light from where one looks */
    return rgb[0];
}

/* Over normals all around, and half vectors up to 60 degrees away from them. */
static struct tilt measure_tilt(double degrees) {
    struct tilt ret = {.degrees = degrees};
    double all = 0, off = 0;
    int n = 0;
    for (int a = 0; a < AZIMUTH; a++) {
        const struct vec3 normal = direction_of_deg(degrees, 360.0 * a / AZIMUTH);
        for (int k = 0; k < AZIMUTH * 40; k++) {
            const int ring = k / AZIMUTH;
            const struct vec3 h =
                direction_of_deg(1.5 + 2.2 * ring, 360.0 * (k % AZIMUTH) / AZIMUTH);
            if (vec3_dot(h, normal) < 0.5)
                continue;
            const double far =
                vec3_length(vec3_sub(microfacet_half(h, normal, METHOD_ROTATION_APPROXIMATE),
                                     microfacet_half(h, normal, METHOD_ROTATION_EXACT)));
            const double exact = ward_at(normal, h, METHOD_ROTATION_EXACT);
            off += pow(ward_at(normal, h, METHOD_ROTATION_APPROXIMATE) - exact, 2);
            all += exact * exact;
            ret.half_rms += far * far;
            ret.half_worst = fmax(ret.half_worst, far);
            n++;
        }
    }
    ret.half_rms = sqrt(ret.half_rms / n);
    ret.ward_rms = sqrt(off / all);
    return ret;
}

static void draw_line(FILE *file, const struct tilt *tilts, gsize offset, const char *colour,
                      const char *text, double label) {
    fprintf(file, "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"2\" points=\"", colour);
    for (int k = 0; k < STEPS; k++) {
        const double value = G_STRUCT_MEMBER(double, &tilts[k], offset);
        fprintf(file, "%d,%d ", (int)(60 + 6 * tilts[k].degrees), (int)(300 - 200 * value));
    }
    fprintf(file, "\"/>\n<text x=\"75\" y=\"%d\" fill=\"%s\">%s</text>\n", (int)label, colour,
            text);
}

static gboolean plot(const char *path, const struct tilt *tilts) {
    FILE *file = fopen(path, "w");
    if (!file)
        return FALSE;
    fputs("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"580\" height=\"350\" "
          "font-family=\"sans-serif\" font-size=\"14\">\n<rect width=\"580\" height=\"350\" "
          "fill=\"white\"/>\n<path d=\"M60 20V300H550\" fill=\"none\" stroke=\"black\"/>\n",
          file);
    for (int k = 0; k <= 80; k += 20)
        fprintf(file, "<text x=\"%d\" y=\"318\" text-anchor=\"middle\">%d°</text>\n", 60 + 6 * k,
                k);
    for (int k = 0; k <= 5; k++)
        fprintf(file, "<text x=\"52\" y=\"%d\" text-anchor=\"end\">%.2f</text>\n", 305 - 50 * k,
                k / 4.0);
    fputs("<text x=\"300\" y=\"340\" text-anchor=\"middle\">tilt of the normal</text>\n", file);
    draw_line(file, tilts, G_STRUCT_OFFSET(struct tilt, half_worst), "#c33",
              "half vector, largest difference", 40);
    draw_line(file, tilts, G_STRUCT_OFFSET(struct tilt, half_rms), "#36c", "half vector, RMS", 60);
    draw_line(file, tilts, G_STRUCT_OFFSET(struct tilt, ward_rms), "#393",
              "Ward 0.1, 0.5, relative RMS", 80);
    fputs("</svg>\n", file);
    return fclose(file) == 0;
}

static void tell_tilts(const struct tilt *tilts) {
    for (int k = 0; k < STEPS; k++)
        bench_row(NULL, "%g{tilt_deg} %.4f{half_rms} %.4f{half_worst} %.4f{ward_relative_rms}",
                  tilts[k].degrees, tilts[k].half_rms, tilts[k].half_worst, tilts[k].ward_rms);
}

static void tell_times(const char *name, const double *ms, const double *times) {
    bench_row(NULL,
              "%-16s{method} %.2f{none_ms} %.2f{exact_ms} %.2f{approximate_ms} %.4f{exact_ratio} "
              "%.4f{approximate_ratio} %.2f{limit}",
              name, ms[METHOD_ROTATION_NONE], ms[METHOD_ROTATION_EXACT],
              ms[METHOD_ROTATION_APPROXIMATE], times[METHOD_ROTATION_EXACT],
              times[METHOD_ROTATION_APPROXIMATE], LIMIT);
}

static gboolean bench(int frames, GError **error) {
    g_autoptr(Gpu) gpu = gpu_new_headless(error);
    g_autoptr(Viewer) viewer = gpu ? viewer_new(NULL, error) : NULL;
    struct mesh *mesh = scene_torus(1.0, 0.4, 192, 96);
    gboolean good = viewer && viewer_set_mesh(viewer, mesh, error);
    if (gpu)
        bench_put("%s{renderer}", gpu_renderer());
    bench_begin_list("times");
    for (int k = 0; good && k < MICROFACET_METHODS; k++) {
        double ms[METHOD_ROTATIONS] = {0}, times[METHOD_ROTATIONS] = {0};
        /* Of each rotation; ret_times: as long as none takes, which is the last. */
        Viewer *viewers[METHOD_ROTATIONS];
        struct viewer_settings settings[METHOD_ROTATIONS];
        for (int way = 0; way < METHOD_ROTATIONS; way++) {
            viewers[way] = viewer;
            settings[way] = viewer_settings_default;
            settings[way].style.rotation = (enum method_rotation)way;
        }
        good = viewer_open(viewer, &methods_microfacet[k], NULL, error) &&
               time_in_turns(viewers, settings, METHOD_ROTATIONS, frames, ms, times, error);
        if (good)
            tell_times(methods_microfacet[k].name, ms, times);
    }
    mesh_free(mesh);
    bench_end();
    return good && microfacet_times(frames, error);
}

int main(int argc, char **argv) {
    int frames = 15;
    g_autofree char *svg = NULL, *lobes = NULL, *fabric = NULL;
    const GOptionEntry entries[] = {
        {"frames", 0, 0, G_OPTION_ARG_INT, &frames, "Timed frames of each, default 15", "N"},
        {"fabric", 0, 0, G_OPTION_ARG_FILENAME, &fabric, "Draw fabric, time nothing", "OUT.png"},
        {"lobes", 0, 0, G_OPTION_ARG_FILENAME, &lobes, "Draw distributions, time nothing",
         "OUT.png"},
        {"plot", 0, 0, G_OPTION_ARG_FILENAME, &svg, "Draw the error over the tilt", "OUT.svg"},
        {NULL}};
    g_autoptr(GError) error = NULL;
    struct tilt tilts[STEPS];
    bench_parse(&argc, &argv, entries, NULL);
    if (frames < 1 || argc > 1)
        bench_fail(2, "bad arguments");
    if (lobes)
        microfacet_lobes(lobes);
    if (fabric)
        microfacet_fabric(fabric, &error);
    bench_check(error);
    if (lobes || fabric)
        return 0;
    for (int k = 0; k < STEPS; k++)
        tilts[k] = measure_tilt(5.0 * k);
    bench_begin(NULL);
    const gboolean plotted = bench(frames, &error) && (!svg || plot(svg, tilts));
    bench_begin_list("tilts");
    tell_tilts(tilts);
    bench_end();
    bench_end();
    bench_check(error);
    if (!plotted)
        bench_fail(1, "%s: the plot cannot be written", svg);
    return 0;
}
