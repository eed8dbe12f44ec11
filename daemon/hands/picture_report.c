#include "picture_report.h"

#include <cairo.h>
#include <math.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include "capture/thumbnail.h"
#include "exr/exr.h"

#define DARK_PART   (1.0 / 256)
#define ASK_WAIT_MS 200
/* Size of a terminal's cell if it does not report one: for the size of a sixel picture. */
#define CELL_WIDTH  8
#define CELL_HEIGHT 16
#define LEVELS      6 /* of each colour in a sixel picture */

struct picture_report picture_report(const Frame *frame) {
    struct picture_report ret = {0};
    const gsize n = (gsize)frame->width * (gsize)frame->height;
    const int top = (1 << frame->bits) - 1, step = frame->cfa == CFA_MONO ? 1 : 2;
    const double dark_dn = frame->black_level + DARK_PART * (top - frame->black_level);
    gsize saturated = 0, dark = 0, inner = 0, above = 0;
    g_autofree guint *counts = g_new0(guint, (gsize)top + 1);
    double sum = 0, squares = 0;
    for (gsize i = 0; i < n; i++) {
        const int dn = MIN(frame->pixels[i], top);
        sum += dn;
        counts[dn]++;
        ret.max_dn = MAX(ret.max_dn, dn);
        saturated += dn == top;
        dark += dn < dark_dn;
        ret.bins[(gsize)dn * PICTURE_BINS / ((gsize)top + 1)]++;
    }
    for (int y = step; y < frame->height - step; y++)
        for (int x = step; x < frame->width - step; x++) {
            const guint16 *at = &frame->pixels[(gsize)y * (gsize)frame->width + (gsize)x];
            const gssize row = (gssize)step * frame->width;
            const double laplacian = 4.0 * at[0] - at[-step] - at[step] - at[-row] - at[row];
            squares += laplacian * laplacian;
            inner++;
        }
    for (ret.high_dn = top; ret.high_dn > 0; ret.high_dn--)
        if ((above += counts[(int)ret.high_dn]) * 100 > n)
            break;
    ret.mean_dn = sum / (double)n;
    ret.saturated = (double)saturated / (double)n;
    ret.dark = (double)dark / (double)n;
    const double light = ret.mean_dn - frame->black_level;
    ret.focus = inner > 0 && light > DARK_PART * top ? sqrt(squares / (double)inner) / light : 0;
    return ret;
}

/* Bars of the square roots, so that small bins stay visible. */
static char *histogram_text(const guint bins[PICTURE_BINS]) {
    static const char *const bars[] = {" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
    GString *text = g_string_new(NULL);
    guint most = 1;
    for (int i = 0; i < PICTURE_BINS; i++)
        most = MAX(most, bins[i]);
    for (int i = 0; i < PICTURE_BINS; i++)
        g_string_append(text, bars[(int)ceil(8 * sqrt((double)bins[i] / most))]);
    return g_string_free(text, FALSE);
}

void picture_report_tell(Record *to, const char *camera, const Frame *frame,
                         const struct picture_report *report) {
    g_autofree char *bars = histogram_text(report->bins);
    const int top = (1 << frame->bits) - 1;
    double bins[PICTURE_BINS];
    for (int i = 0; i < PICTURE_BINS; i++)
        bins[i] = report->bins[i];
    record_string(to, "camera", camera);
    record_int(to, "width", frame->width);
    record_int(to, "height", frame->height);
    record_int(to, "bits", frame->bits);
    record_string(to, "cfa", cfa_name(frame->cfa));
    record_int(to, "exposure_us", frame->exposure_us);
    record_double(to, "mean_dn", report->mean_dn);
    record_double(to, "max_dn", report->max_dn);
    record_double(to, "saturated_pct", 100 * report->saturated);
    record_double(to, "dark_pct", 100 * report->dark);
    record_double(to, "focus", report->focus);
    record_doubles(to, "histogram", bins, PICTURE_BINS);
    record_say(to, "%s  %d × %d pixels of %d bits (%s), exposed for %" G_GINT64_FORMAT " µs\n",
               camera, frame->width, frame->height, frame->bits, cfa_name(frame->cfa),
               frame->exposure_us);
    record_say(to, "mean %.0f DN of %d, brightest %.0f; %.2f %% saturated, %.2f %% dark; ",
               report->mean_dn, top, report->max_dn, 100 * report->saturated, 100 * report->dark);
    if (report->focus > 0)
        record_say(to, "focus %.4f\n", report->focus);
    else
        record_say(to, "too dark to tell the focus\n");
    record_say(to, "0 %s %d\n", bars, top);
}

static gboolean write_png(const char *path, const Frame *frame, GError **error) {
    int width = 0, height = 0;
    g_autofree guint8 *rgb = NULL;
    thumbnail_make_sized(frame, G_MAXINT16, &width, &height, &rgb);
    cairo_surface_t *surface = cairo_image_surface_create(CAIRO_FORMAT_RGB24, width, height);
    guint8 *to = cairo_image_surface_get_data(surface);
    const int stride = cairo_image_surface_get_stride(surface);
    for (int y = 0; to && y < height; y++)
        for (int x = 0; x < width; x++) {
            const guint8 *from = &rgb[((gsize)y * (gsize)width + (gsize)x) * 3];
            const guint32 value = (guint32)from[0] << 16 | (guint32)from[1] << 8 | from[2];
            memcpy(to + (gsize)y * (gsize)stride + (gsize)x * 4, &value, sizeof value);
        }
    cairo_surface_mark_dirty(surface);
    const cairo_status_t status = cairo_surface_write_to_png(surface, path);
    cairo_surface_destroy(surface);
    if (status != CAIRO_STATUS_SUCCESS)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED, "%s: cannot be written: %s", path,
                    cairo_status_to_string(status));
    return status == CAIRO_STATUS_SUCCESS;
}

static gboolean write_exr(const char *path, const char *camera, const Frame *frame,
                          GError **error) {
    static const char *const channels[] = {"Y", NULL};
    struct exr_part *part = exr_part_new("frame", frame->width, frame->height, channels, EXR_FLOAT);
    g_autoptr(ExrFile) file = exr_file_new();
    exr_set_string(part, "mesorig.camera", camera);
    exr_set_string(part, "mesorig.cfa", cfa_name(frame->cfa));
    exr_set_double(part, "mesorig.exposure_us", (double)frame->exposure_us);
    exr_set_int(part, "mesorig.bits", frame->bits);
    exr_set_double(part, "mesorig.black_dn", frame->black_level);
    exr_set_string(part, "mesorig.unit", "DN");
    for (gsize i = 0; i < (gsize)part->width * (gsize)part->height; i++)
        part->planes[0][i] = frame->pixels[i];
    exr_file_add(file, part);
    return exr_write(path, file, EXR_PIZ, FALSE, error);
}

gboolean picture_write(const char *path, const char *camera, const Frame *frame, GError **error) {
    if (g_str_has_suffix(path, ".png"))
        return write_png(path, frame, error);
    if (g_str_has_suffix(path, ".exr"))
        return write_exr(path, camera, frame, error);
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_FILENAME,
                "%s: pictures are written as PNG or OpenEXR; give a name that ends in .png or .exr",
                path);
    return FALSE;
}

/* The primary device attributes (DA1): "ESC [ ? 6 2 ; 4 ; … c", where 4 stands for sixels. */
static gboolean has_sixels(void) {
    struct termios before, raw;
    char answer[128] = "";
    gsize n = 0;
    if (tcgetattr(STDIN_FILENO, &before) != 0)
        return FALSE;
    raw = before;
    raw.c_lflag &= ~(tcflag_t)(ICANON | ECHO);
    tcsetattr(STDIN_FILENO, TCSANOW, &raw);
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    if (write(STDOUT_FILENO, "\033[c", 3) == 3)
        while (n < sizeof answer - 1 && !strchr(answer, 'c') && poll(&input, 1, ASK_WAIT_MS) > 0) {
            const gssize got = read(STDIN_FILENO, answer + n, sizeof answer - 1 - n);
            if (got <= 0)
                break;
            n += (gsize)got;
            answer[n] = '\0';
        }
    tcsetattr(STDIN_FILENO, TCSANOW, &before);
    return g_regex_match_simple("^\\x1b\\[\\?\\d+(;\\d+)*;4(;\\d+)*c", answer, 0, 0);
}

enum picture_way picture_way(void) {
    if (!isatty(STDOUT_FILENO) || !g_get_charset(NULL))
        return PICTURE_NOT;
    return isatty(STDIN_FILENO) && tcgetpgrp(STDIN_FILENO) == getpgrp() && has_sixels()
               ? PICTURE_SIXEL
               : PICTURE_BLOCKS;
}

void picture_terminal_size(int *ret_columns, int *ret_lines) {
    struct winsize size;
    const gboolean known = ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    *ret_columns = known ? size.ws_col : 80;
    *ret_lines = known && size.ws_row > 0 ? size.ws_row : 24;
}

/* Two pixels a cell, in 24-bit colours: the upper half block over a background. */
static void append_blocks(GString *to, const guint8 *rgb, int width, int height) {
    for (int y = 0; y < height; y += 2) {
        for (int x = 0; x < width; x++) {
            const guint8 *up = &rgb[((gsize)y * (gsize)width + (gsize)x) * 3];
            const guint8 *low = y + 1 < height ? up + (gsize)width * 3 : up;
            g_string_append_printf(to, "\033[38;2;%d;%d;%dm\033[48;2;%d;%d;%dm▀", up[0], up[1],
                                   up[2], low[0], low[1], low[2]);
        }
        g_string_append(to, "\033[0m\n");
    }
}

/* Sixels: bands of six rows, each drawn once for every colour that it has. */
static void append_sixels(GString *to, const guint8 *rgb, int width, int height) {
    g_string_append_printf(to, "\033Pq\"1;1;%d;%d", width, height);
    for (int c = 0; c < LEVELS * LEVELS * LEVELS; c++)
        g_string_append_printf(to, "#%d;2;%d;%d;%d", c, c / (LEVELS * LEVELS) * 100 / (LEVELS - 1),
                               c / LEVELS % LEVELS * 100 / (LEVELS - 1),
                               c % LEVELS * 100 / (LEVELS - 1));
    g_autofree guint8 *bits = g_new(guint8, width);
    for (int top = 0; top < height; top += 6) {
        for (int c = 0; c < LEVELS * LEVELS * LEVELS; c++) {
            gboolean any = FALSE;
            memset(bits, 0, (gsize)width);
            for (int y = top; y < MIN(top + 6, height); y++)
                for (int x = 0; x < width; x++) {
                    const guint8 *p = &rgb[((gsize)y * (gsize)width + (gsize)x) * 3];
                    const int r = (p[0] * (LEVELS - 1) + 127) / 255,
                              g = (p[1] * (LEVELS - 1) + 127) / 255,
                              b = (p[2] * (LEVELS - 1) + 127) / 255;
                    if ((r * LEVELS + g) * LEVELS + b != c)
                        continue;
                    bits[x] |= (guint8)(1 << (y - top));
                    any = TRUE;
                }
            if (!any)
                continue;
            g_string_append_printf(to, "#%d", c);
            for (int x = 0; x < width; x++)
                g_string_append_c(to, (char)(63 + bits[x]));
            g_string_append_c(to, '$');
        }
        g_string_append_c(to, '-');
    }
    g_string_append(to, "\033\\\n");
}

char *picture_text(const Frame *frame, enum picture_way way, int columns, int lines) {
    GString *text = g_string_new(NULL);
    const gboolean blocks = way == PICTURE_BLOCKS;
    const int across = MAX(columns, 1) * (blocks ? 1 : CELL_WIDTH);
    const int down = MAX(lines, 1) * (blocks ? 2 : CELL_HEIGHT);
    /* The longer side that fits both ways. */
    const double wide = across * MAX(1.0, (double)frame->height / frame->width);
    const double high = down * MAX(1.0, (double)frame->width / frame->height);
    int width = 0, height = 0;
    g_autofree guint8 *rgb = NULL;
    if (way == PICTURE_NOT)
        return g_string_free(text, FALSE);
    thumbnail_make_sized(frame, MAX((int)MIN(wide, high), 1), &width, &height, &rgb);
    (blocks ? append_blocks : append_sixels)(text, rgb, width, height);
    return g_string_free(text, FALSE);
}
