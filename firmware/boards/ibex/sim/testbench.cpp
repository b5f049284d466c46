// Runs a program on the soft core and connects its ports to named pipes of the working directory:
//
//   link.in    bytes to the core           link.out   bytes from it
//   detector   pixels, u16 little-endian   marks      u64 cycle counts, one a mark
//
// Usage: sim PROGRAM.elf [--verbose] [--max-cycles N]
//
// A pipe that is not there is not used; marks is a file, made if there is a link. The exit code is the program's; 3 if the core met two
// faults in a row or ran out of cycles, 2 if it could not be started.

#include <elf.h>
#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "Vsplash_soc.h"
#include "Vsplash_soc___024root.h"
#include "verilated.h"

namespace {

constexpr uint32_t kDmemBase = 0x10000000;
// Cycles of the core from one pixel to the next.
constexpr uint64_t kPixelCycles = 4;
// Fruitless looks for input after which the core is taken to wait.
constexpr int kPatience = 64;
constexpr int kWaitMs = 10;
constexpr size_t kReadAhead = 1 << 16;

[[noreturn]] void refuse(const std::string& why) {
  std::fprintf(stderr, "sim: %s\n", why.c_str());
  std::exit(2);
}

// Bytes that come by a pipe.
class Input {
 public:
  explicit Input(const char* name) : fd_(open(name, O_RDONLY | O_CLOEXEC)) {}

  size_t left() const { return bytes_.size() - taken_; }
  uint8_t at(size_t i) const { return bytes_[taken_ + i]; }
  void take(size_t n) { taken_ += n; }
  bool ended() const { return ended_ && left() == 0; }
  int fd() const { return ended_ ? -1 : fd_; }

  // Reads what is there.
  void fill() {
    bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(taken_));
    taken_ = 0;
    const size_t had = bytes_.size();
    bytes_.resize(had + kReadAhead);
    const ssize_t got = read(fd_, bytes_.data() + had, kReadAhead);
    bytes_.resize(had + (got > 0 ? static_cast<size_t>(got) : 0));
    if (got == 0 || (got < 0 && errno != EINTR && errno != EAGAIN)) ended_ = true;
  }

 private:
  int fd_;
  bool ended_ = false;
  std::vector<uint8_t> bytes_;
  size_t taken_ = 0;
};

// Bytes that leave by a pipe or file.
class Output {
 public:
  explicit Output(const char* name, int more = 0)
      : fd_(open(name, O_WRONLY | O_APPEND | O_CLOEXEC | more, 0600)) {}

  void push(const void* data, size_t size) {
    if (fd_ < 0) return;
    const auto* bytes = static_cast<const uint8_t*>(data);
    bytes_.insert(bytes_.end(), bytes, bytes + size);
  }

  // False if nobody reads any more.
  bool flush() {
    size_t done = 0;
    while (done < bytes_.size()) {
      const ssize_t put = write(fd_, bytes_.data() + done, bytes_.size() - done);
      if (put < 0 && errno == EINTR) continue;
      if (put <= 0) return false;
      done += static_cast<size_t>(put);
    }
    bytes_.clear();
    return true;
  }

 private:
  int fd_;
  std::vector<uint8_t> bytes_;
};

template <class Memory>
void place(Memory& memory, uint32_t offset, const char* from, uint32_t size) {
  if (offset + uint64_t{size} > sizeof(memory)) refuse("the program does not fit its memory");
  std::memcpy(reinterpret_cast<char*>(&memory[0]) + offset, from, size);
}

void load(Vsplash_soc& soc, const char* file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) refuse(std::string(file) + ": cannot be read");
  const std::vector<char> elf((std::istreambuf_iterator<char>(in)), {});
  Elf32_Ehdr head;
  if (elf.size() < sizeof head) refuse(std::string(file) + ": not an ELF file");
  std::memcpy(&head, elf.data(), sizeof head);
  if (std::memcmp(head.e_ident, ELFMAG, SELFMAG) != 0 || head.e_ident[EI_CLASS] != ELFCLASS32 ||
      head.e_machine != EM_RISCV) {
    refuse(std::string(file) + ": not an ELF file for 32-bit RISC-V");
  }
  for (unsigned i = 0; i < head.e_phnum; i++) {
    const size_t at = head.e_phoff + size_t{i} * head.e_phentsize;
    Elf32_Phdr part;
    if (at + sizeof part > elf.size()) refuse(std::string(file) + ": cut short");
    std::memcpy(&part, elf.data() + at, sizeof part);
    if (part.p_type != PT_LOAD || part.p_filesz == 0) continue;
    if (uint64_t{part.p_offset} + part.p_filesz > elf.size()) {
      refuse(std::string(file) + ": cut short");
    }
    const char* bytes = elf.data() + part.p_offset;
    if (part.p_paddr >= kDmemBase) {
      place(soc.rootp->splash_soc__DOT__u_dmem__DOT__mem, part.p_paddr - kDmemBase, bytes,
            part.p_filesz);
    } else {
      place(soc.rootp->splash_soc__DOT__u_imem__DOT__mem, part.p_paddr, bytes, part.p_filesz);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const char* program = nullptr;
  bool verbose = false;
  uint64_t max_cycles = UINT64_MAX;
  for (int i = 1; i < argc; i++) {
    const std::string argument = argv[i];
    if (argument == "--verbose") {
      verbose = true;
    } else if (argument == "--max-cycles" && i + 1 < argc) {
      max_cycles = std::strtoull(argv[++i], nullptr, 0);
    } else if (program == nullptr && argument[0] != '-') {
      program = argv[i];
    } else {
      refuse("unknown argument " + argument);
    }
  }
  if (program == nullptr) refuse("usage: sim PROGRAM.elf [--verbose] [--max-cycles N]");

  VerilatedContext context;
  Vsplash_soc soc{&context};
  // Some of Ibex's resets are asynchronous and act on a falling edge, which time 0 has none of.
  soc.clk_i = 0;
  soc.rst_ni = 1;
  soc.link_out_ready_i = 1;
  soc.eval();
  soc.rst_ni = 0;
  soc.eval();
  load(soc, program);

  Output answers("link.out");
  Input requests("link.in"), detector("detector");
  // Someone at the other end of the link may want to look at them.
  Output marks("marks", requests.fd() < 0 ? 0 : O_CREAT);

  const auto start = std::chrono::steady_clock::now();
  uint64_t cycle = 0;
  int code = 3, fruitless = 0;
  bool running = true;
  for (; running && cycle < max_cycles; cycle++) {
    if (cycle == 8) soc.rst_ni = 1;
    soc.link_in_valid_i = requests.left() > 0;
    soc.link_in_i = requests.left() > 0 ? requests.at(0) : 0;
    soc.link_in_closed_i = requests.ended() || requests.fd() < 0;
    soc.pixel_valid_i = detector.left() > 1 && cycle % kPixelCycles == 0;
    if (soc.pixel_valid_i) {
      soc.pixel_i = static_cast<uint16_t>(detector.at(0) | detector.at(1) << 8);
    }
    soc.clk_i = 0;
    soc.eval();
    if (soc.rst_ni) {
      if (soc.link_in_ready_o && soc.link_in_valid_i) {
        requests.take(1);
        fruitless = 0;
      }
      if (soc.pixel_valid_i && soc.pixel_ready_o) {
        detector.take(2);
        fruitless = 0;
      }
      if (soc.link_out_valid_o) {
        const uint8_t byte = soc.link_out_o;
        answers.push(&byte, 1);
      }
      if (soc.mark_o) marks.push(&cycle, sizeof cycle);
      if (soc.console_valid_o) std::putchar(soc.console_o);
      if (soc.done_o) {
        code = static_cast<int>(soc.done_code_o & 0xff);
        running = false;
      }
      if (soc.fault_o) {
        std::fprintf(stderr, "sim: the core met a second fault while it handled one\n");
        running = false;
      }
      if (soc.idle_o) {
        // Marks before answers: whoever reads an answer finds its marks.
        if (!marks.flush() || !answers.flush()) running = false;
        std::fflush(stdout);
        pollfd inputs[2] = {{requests.fd(), POLLIN, 0}, {detector.fd(), POLLIN, 0}};
        if (poll(inputs, 2, ++fruitless > kPatience ? kWaitMs : 0) > 0) {
          if (inputs[0].revents != 0) requests.fill();
          if (inputs[1].revents != 0 && detector.left() < kReadAhead) detector.fill();
        }
      }
    }
    soc.clk_i = 1;
    soc.eval();
  }
  if (running) std::fprintf(stderr, "sim: out of cycles\n");
  marks.flush();
  answers.flush();
  std::fflush(stdout);
  if (verbose) {
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    std::fprintf(stderr, "sim: %llu cycles in %.2f s, %.2f Mcycle/s\n",
                 static_cast<unsigned long long>(cycle), took.count(),
                 static_cast<double>(cycle) / took.count() / 1e6);
  }
  soc.final();
  return code;
}
