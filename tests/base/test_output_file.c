/* Which output files are written, replaced or refused, in every case. Nothing is lost if a finished
 * file cannot get its name. */
#include "base/data_error.h"
#include "base/new_file.h"
#include "base/output_file.h"
#include "base/png_bytes.h"
#include "lib/ok.h"
#include "lib/refusing.h"
#include "lib/remove_tree.h"
#include "lib/skip.h"

#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <png.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/un.h>
#include <unistd.h>

#include "exr/exr.h"
#include "lib/test.h"

static char *top;

static const char *in_top(const char *name) {
    g_autofree char *path = g_build_filename(top, name, NULL);
    return g_intern_string(path);
}

static void put(const char *path, const char *text) {
    ok(g_file_set_contents(path, text, -1, ERR));
}

static char *get(const char *path) {
    char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    return text;
}

static void holds(const char *path, const char *text) {
    g_autofree char *is = get(path);
    g_assert_cmpstr(is, ==, text);
}

/* Nothing but these names is in the folder of all files: no unfinished file, no other one. */
static void assert_only(const char *first, ...) {
    g_autoptr(GHashTable) expected = g_hash_table_new(g_str_hash, g_str_equal);
    va_list names;
    va_start(names, first);
    for (const char *name = first; name; name = va_arg(names, const char *))
        g_hash_table_add(expected, (gpointer)name);
    va_end(names);
    g_autoptr(GDir) dir = g_dir_open(top, 0, NULL);
    guint n = 0;
    for (const char *name; (name = g_dir_read_name(dir)); n++)
        if (!g_hash_table_contains(expected, name))
            g_error("%s is left in the folder", name);
    g_assert_cmpuint(n, ==, g_hash_table_size(expected));
}

static void empty_top(void) {
    remove_tree(top);
    g_assert_cmpint(g_mkdir(top, 0777), ==, 0);
}

static void refused(const char *path, const char *kind, gboolean force, int code,
                    const char *said) {
    g_autoptr(GError) error = NULL;
    g_autoptr(OutputFile) file = output_file_new(path, kind, force, &error);
    g_assert_null(file);
    g_assert_error(error, DATA_ERROR, code);
    if (!strstr(error->message, said) || !strstr(error->message, path))
        g_error("“%s” does not say “%s” of %s", error->message, said, path);
    g_assert_false(output_file_check(path, kind, force, NULL));
}

static OutputFile *taken(const char *path, const char *kind, gboolean force) {
    OutputFile *file = ok(output_file_new(path, kind, force, ERR));
    return file;
}

static void delivers(const char *path, const char *kind, gboolean force, const char *text,
                     const char *note) {
    g_autoptr(OutputFile) file = taken(path, kind, force);
    g_assert_true(ok(output_file_put(file, text, strlen(text), ERR)));
    g_assert_cmpstr(output_file_note(file), ==, note);
}

#define OWN   "it replaces the “report” that Mesorig had written there"
#define OTHER "it replaces the existing file"

TEST(names) {
    empty_top();
    const char *path = in_top("a.txt");
    delivers(path, "report", FALSE, "# mesorig.kind: report\nfirst\n", NULL);
    holds(path, "# mesorig.kind: report\nfirst\n");
    delivers(path, "report", FALSE, "# mesorig.kind: report\nsecond\n", OWN);
    refused(path, "board", FALSE, DATA_ERROR_EXISTS, "is not a “board” that Mesorig");
    refused(path, "rep", FALSE, DATA_ERROR_EXISTS, "is not a “rep” that Mesorig");
    refused(path, NULL, FALSE, DATA_ERROR_EXISTS, "exists already: give another name, or --force");
    holds(path, "# mesorig.kind: report\nsecond\n");
    delivers(path, NULL, TRUE, "third", OTHER);
    refused(path, "report", FALSE, DATA_ERROR_EXISTS, "exists already");
    delivers(path, "report", TRUE, "fourth", OTHER);
    holds(path, "fourth");
    refused(in_top("no/a.txt"), NULL, TRUE, DATA_ERROR_IO, "make it first");
    refused(top, NULL, TRUE, DATA_ERROR_EXISTS, "is a folder");
    assert_only("a.txt", NULL);
}

/* What the caller abandons leaves nothing; its error names the output. */
TEST(abandoned) {
    empty_top();
    g_autoptr(GError) error = NULL;
    g_autoptr(OutputFile) file = taken(in_top("b.txt"), NULL, FALSE);
    const char *path = ok(output_file_path(file, ERR));
    g_assert_true(g_str_has_suffix(path, "/b.txt"));
    put(path, "half");
    g_set_error(&error, DATA_ERROR, DATA_ERROR_IO, "%s: no more paper", path);
    g_assert_false(output_file_end(file, FALSE, &error));
    g_autofree char *message = g_strdup_printf("%s: no more paper", in_top("b.txt"));
    g_assert_cmpstr(error->message, ==, message);
    g_clear_pointer(&file, output_file_free);
    assert_only(NULL, NULL);
    /* A program that is killed meanwhile leaves a folder, which the next one removes. */
    OutputFile *killed = taken(in_top("b.txt"), NULL, FALSE);
    put(output_file_path(killed, NULL), "half");
    new_file_remove_left(top, "", "b.txt.");
    assert_only(NULL, NULL);
    output_file_free(killed);
}

/* Reads all that comes through a pipe. */
static gpointer reads(gpointer path) {
    char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    return text;
}

TEST(pipe) {
    empty_top();
    g_autoptr(GError) error = NULL;
    const char *path = in_top("pipe");
    g_assert_cmpint(mkfifo(path, 0600), ==, 0);
    for (int force = 0; force < 2; force++) {
        GThread *reader = g_thread_new("reader", reads, (gpointer)path);
        delivers(path, NULL, force, "through the pipe", NULL);
        g_autofree char *text = g_thread_join(reader);
        g_assert_cmpstr(text, ==, "through the pipe");
    }
    struct stat status;
    g_assert_cmpint(lstat(path, &status), ==, 0);
    g_assert_true(S_ISFIFO(status.st_mode));
    /* A writer that does not ask is stopped at the last step. */
    g_assert_false(output_file_write(path, "x", 1, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_IO);
    g_assert_cmpint(lstat(path, &status), ==, 0);
    g_assert_true(S_ISFIFO(status.st_mode));
    assert_only("pipe", NULL);
}

/* A node like /dev/null, in a folder of the test, which only root can make; others write to the
 * machine's own, which only root could replace. */
TEST(device) {
    empty_top();
    const char *path = in_top("null"), *link = in_top("link");
    const gboolean root = geteuid() == 0;
    if (root && mknod(path, S_IFCHR | 0600, makedev(1, 3)) != 0)
        g_error("mknod: %s", g_strerror(errno));
    g_assert_cmpint(symlink(root ? path : "/dev/null", link), ==, 0);
    const int fd = open(link, O_WRONLY | O_CLOEXEC);
    if (fd < 0) {
        test_skip_or_fail("devices cannot be opened in the temporary folder");
        return;
    }
    close(fd);
    for (int force = 0; force < 2; force++) {
        if (root)
            delivers(path, "report", force, "nowhere", NULL);
        delivers(link, "report", force, "nowhere", NULL);
    }
    struct stat status;
    g_assert_cmpint(stat(link, &status), ==, 0);
    g_assert_true(S_ISCHR(status.st_mode));
    g_assert_cmpint(lstat(link, &status), ==, 0);
    g_assert_true(S_ISLNK(status.st_mode));
}

TEST(socket) {
    empty_top();
    const char *path = in_top("socket");
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    g_strlcpy(address.sun_path, path, sizeof address.sun_path);
    g_assert_cmpint(bind(fd, (struct sockaddr *)&address, sizeof address), ==, 0);
    refused(path, NULL, TRUE, DATA_ERROR_EXISTS, "is a socket");
    close(fd);
    assert_only("socket", NULL);
}

TEST(links) {
    empty_top();
    const char *link = in_top("link"), *to = in_top("to.txt");
    g_assert_cmpint(symlink("to.txt", link), ==, 0);
    refused(link, "report", TRUE, DATA_ERROR_EXISTS, "to a file that does not exist");
    put(to, "of the user");
    refused(link, "report", FALSE, DATA_ERROR_EXISTS, "exists already");
    holds(to, "of the user");
    delivers(link, "report", TRUE, "mesorig.kind: report", OTHER);
    holds(to, "mesorig.kind: report");
    struct stat status;
    g_assert_cmpint(lstat(link, &status), ==, 0);
    g_assert_true(S_ISLNK(status.st_mode));
    assert_only("link", "to.txt", NULL);
}

/* The finished file that a message ends with. */
static void kept(const GError *error, const char *text) {
    const char *at = strstr(error->message, "the finished file is ");
    g_assert_nonnull(at);
    at += strlen("the finished file is ");
    g_assert_true(g_str_has_prefix(at, in_top("late-")) && g_str_has_suffix(at, ".txt"));
    holds(at, text);
    g_assert_cmpint(g_unlink(at), ==, 0);
}

/* Another program makes, or changes, the file while this one works. */
TEST(meanwhile) {
    empty_top();
    const char *path = in_top("late.txt");
    g_autoptr(GError) error = NULL;
    g_autoptr(OutputFile) file = taken(path, "report", FALSE);
    put(path, "of another");
    g_assert_false(output_file_put(file, "mine", 4, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_EXISTS);
    kept(error, "mine");
    holds(path, "of another");
    g_clear_error(&error);
    g_clear_pointer(&file, output_file_free);

    for (int force = 0; force < 2; force++) {
        put(path, "mesorig.kind: report");
        file = taken(path, "report", force);
        put(path, "edited");
        g_assert_false(output_file_put(file, "mine", 4, &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_EXISTS);
        kept(error, "mine");
        holds(path, "edited");
        g_clear_error(&error);
        g_clear_pointer(&file, output_file_free);
    }

    file = taken(path, NULL, TRUE); /* and here it is removed */
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_true(output_file_put(file, "mine", 4, &error));
    holds(path, "mine");
    g_clear_pointer(&file, output_file_free);
    assert_only("late.txt", NULL);
}

TEST(moves) {
    empty_top();
    const char *from = in_top("from"), *to = in_top("to");
    put(from, "from");
    put(to, "to");
    g_assert_false(output_file_move(from, to));
    g_assert_cmpint(errno, ==, EEXIST);
    holds(to, "to");
    g_assert_true(output_file_move(from, in_top("free")));
    g_assert_cmpint(g_mkdir(in_top("folder"), 0777), ==, 0);
    g_assert_cmpint(g_mkdir(in_top("there"), 0777), ==, 0);
    g_autoptr(GError) error = NULL;
    g_assert_false(output_file_move_folder(in_top("folder"), in_top("there"), &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_EXISTS);
    const char *at = strstr(error->message, "folder is ");
    g_assert_nonnull(at);
    g_assert_true(g_file_test(at + strlen("folder is "), G_FILE_TEST_IS_DIR));
    g_assert_false(g_file_test(in_top("folder"), G_FILE_TEST_EXISTS));
}

/* The same on file systems on which a rename always replaces; with and without hard links. */
static gpointer moves_bare(gpointer links) {
    struct new_file file;
    refusing_begin(GPOINTER_TO_INT(links));
    test_moves();
    test_names();
    test_meanwhile();
    /* Space cannot be reserved: a write-only file then only gets its length. */
    g_assert_true(new_file_begin(&file, top, "reserved"));
    static const char begin[5000];
    g_assert_true(new_file_put(&file, begin, sizeof begin));
    g_assert_true(new_file_reserve(&file, 100000));
    g_assert_true(new_file_commit(&file, FALSE));
    struct stat status;
    g_assert_cmpint(stat(in_top("reserved"), &status), ==, 0);
    g_assert_cmpint(status.st_size, ==, 100000);
    return NULL;
}

TEST(bare) {
    for (int links = 0; links < 2; links++)
        g_thread_join(g_thread_new("bare", moves_bare, GINT_TO_POINTER(links)));
}

/* A file of each format that can store its kind is recognised, and its readers read it as before.
 */
static void written_as(OutputFile *file, const char *kind, gboolean ok, GError *error) {
    g_assert_no_error(error);
    g_assert_true(ok(output_file_end(file, ok, ERR)));
    output_file_free(file);
}

TEST(formats) {
    empty_top();
    const guint8 rgb[12] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    GError *error = NULL;
    OutputFile *file = taken(in_top("a.png"), "snap", FALSE);
    g_autoptr(GBytes) png = png_bytes(rgb, 2, 2, &error);
    g_assert_true(
        output_file_put(file, g_bytes_get_data(png, NULL), g_bytes_get_size(png), &error));
    output_file_free(file);
    png_image image = {.version = PNG_IMAGE_VERSION};
    guint8 back[12];
    g_assert_true(png_image_begin_read_from_file(&image, in_top("a.png")));
    image.format = PNG_FORMAT_RGB;
    g_assert_true(png_image_finish_read(&image, NULL, back, 0, NULL));
    g_assert_cmpint(image.warning_or_error, ==, 0);
    g_assert_cmpmem(back, 12, rgb, 12);

    static const char *const channels[] = {"Y", NULL};
    file = taken(in_top("a.exr"), "height", FALSE);
    g_autoptr(ExrFile) exr = exr_file_new();
    struct exr_part *part = exr_part_new("a", 2, 2, channels, EXR_FLOAT);
    exr_set_string(part, "mesorig.kind", "height");
    exr_set_string(part, "mesorig.name", "a"); /* whose name follows the kind */
    exr_file_add(exr, part);
    written_as(file, "height",
               exr_write(output_file_path(file, &error), exr, EXR_ZIP, FALSE, &error), error);
    g_autoptr(ExrPart) read = exr_read_part(in_top("a.exr"), "a", &error);
    g_assert_no_error(error);

    file = taken(in_top("a.svg"), "plot", FALSE);
    cairo_surface_t *surface = cairo_svg_surface_create(output_file_path(file, &error), 10, 10);
    cairo_surface_destroy(surface);
    written_as(file, "plot", TRUE, error);
    g_autofree char *svg = get(in_top("a.svg"));
    g_autoptr(GMarkupParseContext) parser =
        g_markup_parse_context_new(&(GMarkupParser){0}, 0, NULL, NULL);
    g_assert_true(g_markup_parse_context_parse(parser, svg, -1, &error) &&
                  g_markup_parse_context_end_parse(parser, &error));
    g_assert_true(g_str_has_prefix(svg, "<?xml"));

    file = taken(in_top("a.pdf"), "board", FALSE);
    surface = cairo_pdf_surface_create(output_file_path(file, &error), 10, 10);
    cairo_surface_destroy(surface);
    written_as(file, "board", TRUE, error);
    g_autofree char *pdf = get(in_top("a.pdf"));
    g_assert_true(g_str_has_prefix(pdf, "%PDF"));

    delivers(in_top("a.html"), "report", FALSE, "<!DOCTYPE html>\n<html></html>\n", NULL);
    g_autofree char *html = get(in_top("a.html"));
    g_assert_true(g_str_has_prefix(html, "<!DOCTYPE html>\n<!-- mesorig.kind: report -->"));

    const char *const names[][3] = {{"a.png", "snap", "sna"},
                                    {"a.exr", "height", "heigh"},
                                    {"a.svg", "plot", "plo"},
                                    {"a.pdf", "board", "boar"},
                                    {"a.html", "report", "repor"}};
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        const char *path = in_top(names[i][0]);
        g_assert_true(output_file_check(path, names[i][1], FALSE, NULL));
        g_assert_false(output_file_check(path, names[i][2], FALSE, NULL));
        g_assert_false(output_file_check(path, NULL, FALSE, NULL));
    }
}

BEFORE_TESTS {
    top = g_dir_make_tmp("mesorig-output-XXXXXX", NULL);
}

AFTER_TESTS {
    remove_tree(top);
    g_free(top);
}
