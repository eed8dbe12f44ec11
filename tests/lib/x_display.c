#include "x_display.h"

#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <X11/extensions/XTest.h>
#include <X11/XKBlib.h>
#include <X11/Xlib.h>
#include <X11/Xutil.h>

#define STEP_US 20000 /* pause between two events, so that a program handles them separately */

struct XDisplay {
    GPid server;
    char *name;
    Display *display;
    Window window;
};

/* Reads the number of the display, which the server writes to a pipe when it accepts
 * connections. */
static char *read_number(int from) {
    char text[16] = "";
    gsize n = 0;
    while (n < sizeof text - 1 && read(from, text + n, 1) == 1 && text[n] != '\n')
        n++;
    text[n] = '\0';
    return n > 0 ? g_strdup_printf(":%s", text) : NULL;
}

/* Kills the server if the test ends early, so that no server or client is left behind. */
static void die_with_parent(gpointer data) {
    prctl(PR_SET_PDEATHSIG, SIGTERM);
}

XDisplay *x_display_new(void) {
    const char *const argv[] = {"Xvfb",        "-displayfd", "1",   "-screen",  "0",
                                "1024x768x24", "-nolisten",  "tcp", "-noreset", NULL};
    int out = -1;
    XDisplay *x = g_new0(XDisplay, 1);
    if (g_spawn_async_with_pipes(NULL, (char **)argv, NULL,
                                 G_SPAWN_SEARCH_PATH | G_SPAWN_DO_NOT_REAP_CHILD |
                                     G_SPAWN_STDERR_TO_DEV_NULL,
                                 die_with_parent, NULL, &x->server, NULL, &out, NULL, NULL)) {
        x->name = read_number(out);
        close(out);
        x->display = x->name != NULL ? XOpenDisplay(x->name) : NULL;
    }
    if (x->display == NULL)
        g_clear_pointer(&x, x_display_free);
    return x;
}

void x_display_kill(XDisplay *x) {
    /* first: when the server ends, Xlib ends each program that is still connected to it */
    if (x->display != NULL)
        XCloseDisplay(x->display);
    x->display = NULL;
    if (x->server == 0)
        return;
    kill(x->server, SIGTERM);
    waitpid(x->server, NULL, 0);
    x->server = 0;
}

void x_display_free(XDisplay *x) {
    if (x == NULL)
        return;
    x_display_kill(x);
    g_free(x->name);
    g_free(x);
}

const char *x_display_name(const XDisplay *x) {
    return x->name;
}

static Window find_window(Display *display) {
    Window root, parent, *children = NULL, found = None;
    unsigned n = 0;
    if (!XQueryTree(display, DefaultRootWindow(display), &root, &parent, &children, &n))
        return None;
    for (unsigned k = 0; k < n; k++) {
        XWindowAttributes attributes;
        if (XGetWindowAttributes(display, children[k], &attributes) &&
            attributes.map_state == IsViewable)
            found = children[k];
    }
    if (children != NULL)
        XFree(children);
    return found;
}

gboolean x_display_wait_window(XDisplay *x, double seconds) {
    const gint64 until = g_get_monotonic_time() + (gint64)(seconds * G_USEC_PER_SEC);
    do {
        x->window = find_window(x->display);
        if (x->window != None) {
            XSetInputFocus(x->display, x->window, RevertToPointerRoot, CurrentTime);
            XSync(x->display, False);
            return TRUE;
        }
        g_usleep(STEP_US);
    } while (g_get_monotonic_time() < until);
    return FALSE;
}

static void settle(XDisplay *x) {
    XSync(x->display, False);
    g_usleep(STEP_US);
}

char *x_display_title(XDisplay *x) {
    XTextProperty name = {0};
    XGetTextProperty(x->display, x->window, &name, XInternAtom(x->display, "_NET_WM_NAME", False));
    char *title = g_strdup(name.value != NULL ? (const char *)name.value : "");
    if (name.value != NULL)
        XFree(name.value);
    return title;
}

void x_display_key(XDisplay *x, const char *key) {
    const KeySym symbol = XStringToKeysym(key);
    const KeyCode code = XKeysymToKeycode(x->display, symbol);
    const gboolean shift = XkbKeycodeToKeysym(x->display, code, 0, 0) != symbol;
    const KeyCode shift_code = XKeysymToKeycode(x->display, XStringToKeysym("Shift_L"));
    g_assert_cmpint(code, !=, 0);
    if (shift)
        XTestFakeKeyEvent(x->display, shift_code, True, CurrentTime);
    XTestFakeKeyEvent(x->display, code, True, CurrentTime);
    settle(x);
    XTestFakeKeyEvent(x->display, code, False, CurrentTime);
    if (shift)
        XTestFakeKeyEvent(x->display, shift_code, False, CurrentTime);
    settle(x);
}

static void press_key(XDisplay *x, const char *key, Bool down) {
    if (key == NULL)
        return;
    const KeyCode code = XKeysymToKeycode(x->display, XStringToKeysym(key));
    g_assert_cmpint(code, !=, 0);
    XTestFakeKeyEvent(x->display, code, down, CurrentTime);
}

void x_display_chord(XDisplay *x, const char *before, const char *held, const char *key) {
    press_key(x, before, True);
    press_key(x, held, True);
    x_display_key(x, key);
    press_key(x, held, False);
    press_key(x, before, False);
    settle(x);
}

void x_display_type(XDisplay *x, const char *text) {
    for (; *text != '\0'; text++) {
        /* names of Latin 1 characters are the same in the keysym table */
        const char *name = XKeysymToString((KeySym)(guchar)*text);
        g_assert_nonnull(name);
        x_display_key(x, name);
    }
}

void x_display_size(XDisplay *x, int *ret_width, int *ret_height) {
    XWindowAttributes attributes;
    g_assert_true(XGetWindowAttributes(x->display, x->window, &attributes));
    *ret_width = attributes.width;
    *ret_height = attributes.height;
}

void x_display_move(XDisplay *x, int to_x, int to_y) {
    int root_x = 0, root_y = 0;
    Window child;
    XTranslateCoordinates(x->display, x->window, DefaultRootWindow(x->display), to_x, to_y, &root_x,
                          &root_y, &child);
    XTestFakeMotionEvent(x->display, 0, root_x, root_y, CurrentTime);
    settle(x);
}

void x_display_press(XDisplay *x, int button, gboolean down) {
    XTestFakeButtonEvent(x->display, (unsigned)button, down, CurrentTime);
    settle(x);
}

void x_display_drag(XDisplay *x, int button, int from_x, int from_y, int by_x, int by_y) {
    x_display_move(x, from_x, from_y);
    x_display_press(x, button, TRUE);
    for (int k = 1; k <= 5; k++)
        x_display_move(x, from_x + by_x * k / 5, from_y + by_y * k / 5);
    x_display_press(x, button, FALSE);
}

void x_display_click(XDisplay *x, int button, int at_x, int at_y) {
    x_display_drag(x, button, at_x, at_y, 0, 0);
}

static Atom atom(XDisplay *x, const char *name) {
    return XInternAtom(x->display, name, False);
}

static void send_message(XDisplay *x, Window source, const char *type, const long data[4]) {
    XEvent event = {.xclient = {.type = ClientMessage,
                                .window = x->window,
                                .message_type = atom(x, type),
                                .format = 32}};
    event.xclient.data.l[0] = (long)source;
    for (int k = 0; k < 4; k++)
        event.xclient.data.l[k + 1] = data[k];
    XSendEvent(x->display, x->window, False, NoEventMask, &event);
    XFlush(x->display);
}

/* Answers requests for the text until a message of this type arrives. */
static void wait_message(XDisplay *x, const char *type, const char *text) {
    const gint64 until = g_get_monotonic_time() + 60 * G_USEC_PER_SEC;
    while (g_get_monotonic_time() < until) {
        XEvent event;
        if (XPending(x->display) == 0) {
            g_usleep(STEP_US);
            continue;
        }
        XNextEvent(x->display, &event);
        if (event.type == ClientMessage && event.xclient.message_type == atom(x, type))
            return;
        if (event.type != SelectionRequest)
            continue;
        const XSelectionRequestEvent *asked = &event.xselectionrequest;
        XChangeProperty(x->display, asked->requestor, asked->property, asked->target, 8,
                        PropModeReplace, (const guchar *)text, (int)strlen(text));
        XEvent answer = {.xselection = {.type = SelectionNotify,
                                        .requestor = asked->requestor,
                                        .selection = asked->selection,
                                        .target = asked->target,
                                        .property = asked->property,
                                        .time = asked->time}};
        XSendEvent(x->display, asked->requestor, False, NoEventMask, &answer);
        XFlush(x->display);
    }
    g_error("%s did not come", type);
}

void x_display_drop(XDisplay *x, const char *const *paths) {
    g_autoptr(GString) uris = g_string_new(NULL);
    for (; *paths != NULL; paths++) {
        g_autofree char *uri = g_filename_to_uri(*paths, NULL, NULL);
        g_string_append_printf(uris, "%s\r\n", uri);
    }
    const Window source =
        XCreateSimpleWindow(x->display, DefaultRootWindow(x->display), 0, 0, 1, 1, 0, 0, 0);
    XSetSelectionOwner(x->display, atom(x, "XdndSelection"), source, CurrentTime);
    send_message(x, source, "XdndEnter", (const long[4]){5L << 24, (long)atom(x, "text/uri-list")});
    send_message(
        x, source, "XdndPosition",
        (const long[4]){0, 100L << 16 | 100, CurrentTime, (long)atom(x, "XdndActionCopy")});
    wait_message(x, "XdndStatus", uris->str);
    send_message(x, source, "XdndDrop", (const long[4]){0, CurrentTime});
    wait_message(x, "XdndFinished", uris->str);
    XDestroyWindow(x->display, source);
    settle(x);
}

void x_display_ask_to_close(XDisplay *x) {
    XEvent event = {.xclient = {.type = ClientMessage,
                                .window = x->window,
                                .message_type = XInternAtom(x->display, "WM_PROTOCOLS", False),
                                .format = 32}};
    event.xclient.data.l[0] = (long)XInternAtom(x->display, "WM_DELETE_WINDOW", False);
    event.xclient.data.l[1] = CurrentTime;
    XSendEvent(x->display, x->window, False, NoEventMask, &event);
    settle(x);
}

guint8 *x_display_picture(XDisplay *x, int *ret_width, int *ret_height) {
    XWindowAttributes attributes;
    g_assert_true(XGetWindowAttributes(x->display, x->window, &attributes));
    const int width = attributes.width, height = attributes.height;
    XImage *image = XGetImage(x->display, x->window, 0, 0, (unsigned)width, (unsigned)height,
                              AllPlanes, ZPixmap);
    g_assert_nonnull(image);
    guint8 *rgb = g_malloc((gsize)3 * width * height);
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++) {
            const unsigned long pixel = XGetPixel(image, i, j);
            guint8 *to = rgb + 3 * ((gsize)j * width + i);
            to[0] = (guint8)(pixel >> 16);
            to[1] = (guint8)(pixel >> 8);
            to[2] = (guint8)pixel;
        }
    XDestroyImage(image);
    *ret_width = width;
    *ret_height = height;
    return rgb;
}
