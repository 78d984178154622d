/* Loads the library of a Windows FMU (FMI 2.0, co-simulation) and does what the bridge asks for; see protocol.h.
 *
 *     wine host.exe Z:\...\binaries\win64\name.dll
 *
 * It uses kernel32.dll alone, so that nothing of a compiler's run-time library has to be built. */
#include <stddef.h>

#include "protocol.h"

typedef void *Handle;
typedef unsigned long Word; /* of 32 bits on Windows */
#define SYSTEM __declspec(dllimport) __attribute__((ms_abi))
SYSTEM Handle GetStdHandle(Word which);
SYSTEM int SetStdHandle(Word which, Handle handle);
SYSTEM int ReadFile(Handle file, void *target, Word size, Word *count, void *overlapped);
SYSTEM int WriteFile(Handle file, const void *source, Word size, Word *count, void *overlapped);
SYSTEM Handle GetProcessHeap(void);
SYSTEM void *HeapAlloc(Handle heap, Word flags, size_t size);
SYSTEM int HeapFree(Handle heap, Word flags, void *block);
SYSTEM Handle LoadLibraryA(const char *name);
SYSTEM Handle LoadLibraryExA(const char *name, Handle nothing, Word flags);
SYSTEM void *GetProcAddress(Handle library, const char *name);
SYSTEM Handle CreateThread(void *security, size_t stack, Word (*start)(void *), void *argument, Word flags, Word *id);
SYSTEM char *GetCommandLineA(void);
SYSTEM char *lstrcpynA(char *target, const char *source, int size);
SYSTEM Word SetErrorMode(Word mode);
SYSTEM Handle CreateEventA(void *security, int manual, int set, const char *name);
SYSTEM int SetEvent(Handle event);
SYSTEM Word WaitForSingleObject(Handle event, Word milliseconds);
SYSTEM void ExitProcess(unsigned code);
enum { NO_MESSAGE_BOXES = 0x8003, ZEROED = 8, ITS_FOLDER_FIRST = 8 };
#define FOREVER ((Word)-1)
#define STANDARD_INPUT ((Word)-10)
#define STANDARD_OUTPUT ((Word)-11)
#define STANDARD_ERROR ((Word)-12)

typedef void (*Logger)(void *environment, const char *name, int status, const char *category, const char *message, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*step_finished)(void *environment, int status);
    void *environment;
} Callbacks;
typedef int (*Format)(char *buffer, size_t size, const char *format, __builtin_va_list arguments);

int _fltused = 0;

static Handle calls, answers;
static Handle library;
static void *component;
static Format format_message;
static char *memory;
static size_t room;

void *memcpy(void *target, const void *source, size_t size) {
    char *to = target;
    const char *from = source;
    for (size_t i = 0; i < size; i++) ((volatile char *)to)[i] = from[i];
    return target;
}

void *memset(void *target, int value, size_t size) {
    for (size_t i = 0; i < size; i++) ((volatile char *)target)[i] = (char)value;
    return target;
}

static size_t length_of(const char *text) {
    size_t n = 0;
    while (text && text[n]) n++;
    return n;
}

static void read_all(void *target, size_t size) {
    for (char *at = target; size;) {
        Word count = 0;
        if (!ReadFile(calls, at, (Word)size, &count, NULL) || !count) ExitProcess(0); /* the bridge is gone */
        at += count;
        size -= count;
    }
}

static void write_all(const void *source, size_t size) {
    for (const char *at = source; size;) {
        Word count = 0;
        if (!WriteFile(answers, at, (Word)size, &count, NULL)) ExitProcess(0);
        at += count;
        size -= count;
    }
}

static void answer(int status, const void *values, size_t size) {
    const Answer head = {KIND_RESULT, (uint32_t)size, status, 0};
    write_all(&head, sizeof head);
    write_all(values, size);
}

static void say(void *environment, const char *name, int status, const char *category, const char *message, ...) {
    char text[2048];
    (void)environment, (void)name;
    __builtin_va_list arguments;
    __builtin_va_start(arguments, message);
    if (format_message) {
        format_message(text, sizeof text - 1, message, arguments);
        text[sizeof text - 1] = 0;
    } else {
        lstrcpynA(text, message, sizeof text);
    }
    __builtin_va_end(arguments);
    const size_t first = length_of(category) + 1, second = length_of(text) + 1;
    const Answer head = {KIND_LOG, (uint32_t)(first + second), status, 0};
    write_all(&head, sizeof head);
    write_all(category ? category : "", first);
    write_all(text, second);
}

static void *allocate(size_t count, size_t size) {
    return HeapAlloc(GetProcessHeap(), ZEROED, count * size);
}

static void release(void *block) {
    if (block) HeapFree(GetProcessHeap(), 0, block);
}

static Callbacks callbacks = {say, allocate, release, NULL, NULL};

/* A function of the FMU by its name; where there is none, the call fails. */
#define CALL(result, arguments, name, ...)                                                                            \
    do {                                                                                                               \
        int(*function) arguments = (int(*) arguments)(void *)GetProcAddress(library, name);                            \
        (result) = function ? function(__VA_ARGS__) : STATUS_ERROR;                                                    \
    } while (0)

static char *scratch(size_t size) {
    if (size > room) {
        release(memory);
        memory = allocate(room = 2 * size, 1);
    }
    return memory;
}

static void instantiate(const char *at) {
    const int32_t *flags = (const int32_t *)at;
    const char *name = at + 8, *guid = name + length_of(name) + 1, *resources = guid + length_of(guid) + 1;
    void *(*function)(const char *, int, const char *, const char *, const Callbacks *, int, int) =
        (void *)GetProcAddress(library, "fmi2Instantiate");
    component = function ? function(name, 1, guid, resources, &callbacks, flags[0], flags[1]) : NULL;
    answer(component ? STATUS_OK : STATUS_ERROR, NULL, 0);
}

static void get(const char *at) {
    const int32_t type = *(const int32_t *)at;
    const uint32_t count = *(const uint32_t *)(at + 4), *references = (const uint32_t *)(at + 8);
    int status;
    if (type == TYPE_REAL) {
        double *values = (double *)scratch(count * sizeof *values);
        CALL(status, (void *, const uint32_t *, size_t, double *), "fmi2GetReal", component, references, count, values);
        answer(status, values, count * sizeof *values);
    } else if (type == TYPE_INTEGER || type == TYPE_BOOLEAN) {
        const char *name = type == TYPE_INTEGER ? "fmi2GetInteger" : "fmi2GetBoolean";
        int *values = (int *)scratch(count * sizeof *values);
        CALL(status, (void *, const uint32_t *, size_t, int *), name, component, references, count, values);
        answer(status, values, count * sizeof *values);
    } else {
        const char **texts = allocate(count + 1, sizeof *texts);
        CALL(status, (void *, const uint32_t *, size_t, const char **), "fmi2GetString", component, references, count, texts);
        size_t size = 0, used = 0;
        for (uint32_t i = 0; i < count; i++) size += length_of(texts[i]) + 1;
        char *values = scratch(size + 1);
        for (uint32_t i = 0; i < count; i++) {
            const size_t own = length_of(texts[i]);
            memcpy(values + used, texts[i], own);
            values[used + own] = 0;
            used += own + 1;
        }
        answer(status, values, size);
        release(texts);
    }
}

static void set(const char *at) {
    const int32_t type = *(const int32_t *)at;
    const uint32_t count = *(const uint32_t *)(at + 4), *references = (const uint32_t *)(at + 8);
    const char *values = at + 8 + 4 * (size_t)count;
    int status;
    if (type == TYPE_REAL) {
        double *own = (double *)scratch(count * sizeof *own); /* at an address for numbers of eight bytes */
        memcpy(own, values, count * sizeof *own);
        CALL(status, (void *, const uint32_t *, size_t, const double *), "fmi2SetReal", component, references, count, own);
    } else if (type == TYPE_INTEGER || type == TYPE_BOOLEAN) {
        const char *name = type == TYPE_INTEGER ? "fmi2SetInteger" : "fmi2SetBoolean";
        CALL(status, (void *, const uint32_t *, size_t, const int *), name, component, references, count, (const int *)values);
    } else {
        const char **texts = allocate(count + 1, sizeof *texts);
        for (uint32_t i = 0; i < count; i++) {
            texts[i] = values;
            values += length_of(values) + 1;
        }
        CALL(status, (void *, const uint32_t *, size_t, const char *const *), "fmi2SetString", component, references, count, texts);
        release(texts);
    }
    answer(status, NULL, 0);
}

static void derivative(const char *at) {
    const uint32_t n = *(const uint32_t *)at, m = *(const uint32_t *)(at + 4);
    const uint32_t *unknowns = (const uint32_t *)(at + 8), *knowns = unknowns + n;
    double *values = (double *)scratch((n + m) * sizeof *values), *seeds = values + n;
    memcpy(seeds, knowns + m, m * sizeof *seeds);
    int status;
    CALL(status, (void *, const uint32_t *, size_t, const uint32_t *, size_t, const double *, double *),
         "fmi2GetDirectionalDerivative", component, unknowns, n, knowns, m, seeds, values);
    answer(status, values, n * sizeof *values);
}

static void state(uint32_t op, const char *at) {
    void *held = (void *)(uintptr_t)*(const uint64_t *)at;
    int status;
    if (op == OP_SET_STATE) {
        CALL(status, (void *, void *), "fmi2SetFMUstate", component, held);
    } else {
        const char *name = op == OP_GET_STATE ? "fmi2GetFMUstate" : "fmi2FreeFMUstate";
        CALL(status, (void *, void **), name, component, &held);
    }
    const uint64_t found = (uintptr_t)held;
    answer(status, &found, sizeof found);
}

static void plain(uint32_t op) {
    static const char *const names[] = {"fmi2EnterInitializationMode", "fmi2ExitInitializationMode", "fmi2Terminate", "fmi2Reset"};
    int status;
    CALL(status, (void *), names[op - OP_ENTER], component);
    answer(status, NULL, 0);
}

static void perform(uint32_t op, const char *at) {
    int status = STATUS_OK;
    const double *numbers = (const double *)(at + 8);
    const int32_t *flags = (const int32_t *)at;
    switch (op) {
        case OP_INSTANTIATE: instantiate(at); return;
        case OP_GET: get(at); return;
        case OP_SET: set(at); return;
        case OP_DERIVATIVE: derivative(at); return;
        case OP_GET_STATE: case OP_SET_STATE: case OP_FREE_STATE: state(op, at); return;
        case OP_ENTER: case OP_EXIT: case OP_TERMINATE: case OP_RESET: plain(op); return;
        case OP_SETUP:
            CALL(status, (void *, int, double, double, int, double), "fmi2SetupExperiment", component, flags[0],
                 numbers[0], numbers[1], flags[1], numbers[2]);
            break;
        case OP_STEP:
            CALL(status, (void *, double, double, int), "fmi2DoStep", component, ((const double *)at)[0],
                 ((const double *)at)[1], *(const int32_t *)(at + 16));
            break;
        case OP_DEBUG:
            CALL(status, (void *, int, size_t, const char *const *), "fmi2SetDebugLogging", component, flags[0], (size_t)0, NULL);
            break;
        default: status = STATUS_ERROR;
    }
    answer(status, NULL, 0);
}

/* The call that is done, and what tells that there is one. */
static Call call;
static char *text;
static Handle given;

/* Does the calls, all in one thread. */
static Word work(void *nothing) {
    (void)nothing;
    for (;;) {
        WaitForSingleObject(given, FOREVER);
        if (call.op == OP_FREE) break;
        perform(call.op, text);
    }
    void (*function)(void *) = (void *)GetProcAddress(library, "fmi2FreeInstance");
    if (function && component) function(component);
    answer(STATUS_OK, NULL, 0);
    ExitProcess(0);
    return 0;
}

static char *argument(void) {
    char *at = GetCommandLineA();
    for (int quoted = 0; *at && (quoted || *at != ' '); at++) quoted ^= *at == '"';
    while (*at == ' ' || *at == '"') at++;
    for (size_t end = length_of(at); end && (at[end - 1] == '"' || at[end - 1] == ' '); end--) at[end - 1] = 0;
    return at;
}

void mainCRTStartup(void) {
    calls = GetStdHandle(STANDARD_INPUT);
    answers = GetStdHandle(STANDARD_OUTPUT);
    SetStdHandle(STANDARD_OUTPUT, GetStdHandle(STANDARD_ERROR)); /* what the FMU prints is no answer */
    SetErrorMode(NO_MESSAGE_BOXES);
    Handle runtime = LoadLibraryA("msvcrt.dll");
    format_message = runtime ? (Format)(void *)GetProcAddress(runtime, "_vsnprintf") : NULL;
    library = LoadLibraryExA(argument(), NULL, ITS_FOLDER_FIRST);
    answer(library ? STATUS_OK : STATUS_FATAL, NULL, 0);
    if (!library) ExitProcess(1);
    given = CreateEventA(NULL, 0, 0, NULL);
    CreateThread(NULL, 0, work, NULL, 0, NULL);
    /* The next call is waited for while one is done, so that the process ends with the bridge even if the FMU hangs; it
     * comes after the answer, when nobody reads the text any more. */
    for (uint32_t size = 0;;) {
        Call next;
        read_all(&next, sizeof next);
        if (next.size > size || !text) {
            release(text);
            text = allocate(size = 2 * next.size + 64, 1);
        }
        read_all(text, next.size);
        call = next;
        SetEvent(given);
    }
}
