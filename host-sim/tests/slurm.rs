//! The job array on a real Slurm of one node, whose daemons are started here and listen on loopback.
//!
//! Without Slurm (packages slurm-wlm and munge) it says that it is skipped; with SPLASH_BOARDS, as in
//! tests/run, that is a failure.

mod common;

use serde_json::Value;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longer than anything here takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A cluster of two processors; its daemons end with it.
struct Cluster {
    /// In the order in which they start.
    daemons: Vec<Child>,
    place: tempfile::TempDir,
}

impl Drop for Cluster {
    fn drop(&mut self) {
        for daemon in self.daemons.iter_mut().rev() {
            // It may have ended by itself.
            let _ = Command::new("kill").arg(daemon.id().to_string()).status();
            let _ = daemon.wait();
        }
    }
}

impl Cluster {
    fn start() -> Self {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        for directory in ["state", "spool"] {
            std::fs::create_dir(at(directory)).unwrap();
        }
        let key = std::fs::read("/proc/sys/kernel/random/uuid").unwrap();
        std::fs::write(at("munge.key"), key).unwrap();
        std::fs::set_permissions(at("munge.key"), PermissionsExt::from_mode(0o600)).unwrap();
        std::fs::write(at("slurm.conf"), configuration(place.path())).unwrap();
        let file = |option: &str| format!("--{option}-file={}", at(option).display());
        let mut munged = vec!["--foreground".into(), "--force".into()];
        munged.extend(["pid", "log", "seed"].map(file));
        munged.push(format!("--key-file={}", at("munge.key").display()));
        munged.push(format!("--socket={}", at("munge.socket").display()));
        let configured = ["-D".into(), "-f".into(), at("slurm.conf").display().to_string()];
        let mut cluster = Self { daemons: Vec::new(), place };
        cluster.daemon("munged", &munged);
        cluster.wait("munged's socket", |cluster| cluster.at("munge.socket").exists());
        cluster.daemon("slurmctld", &[&configured[..], &["-c".into()]].concat());
        cluster.daemon("slurmd", &[&configured[..], &["-N".into(), host()]].concat());
        cluster.wait("the node", |cluster| {
            cluster.says("sinfo", &["-h", "-o", "%T"]).as_deref() == Some("idle")
        });
        cluster
    }

    fn at(&self, name: &str) -> PathBuf {
        self.place.path().join(name)
    }

    fn daemon(&mut self, name: &str, arguments: &[String]) {
        let log = std::fs::File::create(self.at(&format!("{name}.out"))).unwrap();
        let mut command = Command::new(program(name).expect("looked for before"));
        command.args(arguments).stdout(log.try_clone().unwrap()).stderr(log);
        self.daemons.push(command.stdin(Stdio::null()).spawn().unwrap());
    }

    /// A command of Slurm's, on this cluster.
    fn command(&self, program: impl AsRef<Path>, arguments: &[&str]) -> Command {
        let mut command = Command::new(program.as_ref());
        command.args(arguments).env("SLURM_CONF", self.at("slurm.conf"));
        command.env("HOST_SIM", env!("CARGO_BIN_EXE_host-sim"));
        command
    }

    /// What it prints; `None` while there is no answer.
    fn says(&self, program: &str, arguments: &[&str]) -> Option<String> {
        let output = self.command(program, arguments).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        output.status.success().then(|| text.trim().to_string())
    }

    fn wait(&self, what: &str, mut there: impl FnMut(&Self) -> bool) {
        let start = Instant::now();
        while !there(self) {
            assert!(start.elapsed() < PATIENCE, "{what} is not there; {}", self.logs());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn logs(&self) -> String {
        let read = |name: &str| std::fs::read_to_string(self.at(name)).unwrap_or_default();
        ["munged.out", "slurmctld.out", "slurmd.out"].map(read).join("\n")
    }
}

/// What `Cluster` runs on: no control groups, no accounting, requeued at once.
fn configuration(place: &Path) -> String {
    let place = place.display();
    let host = host();
    let user = Command::new("id").arg("-un").output().unwrap().stdout;
    let user = String::from_utf8(user).unwrap();
    let user = user.trim();
    let listeners = [0; 2].map(|_| TcpListener::bind("127.0.0.1:0").unwrap());
    let [controller, node] = listeners.each_ref().map(|l| l.local_addr().unwrap().port());
    format!(
        "ClusterName=splash\n\
         SlurmctldHost={host}(127.0.0.1)\n\
         SlurmctldPort={controller}\n\
         SlurmdPort={node}\n\
         AuthType=auth/munge\n\
         AuthInfo=socket={place}/munge.socket\n\
         SlurmUser={user}\n\
         SlurmdUser={user}\n\
         StateSaveLocation={place}/state\n\
         SlurmdSpoolDir={place}/spool\n\
         SlurmctldPidFile={place}/slurmctld.pid\n\
         SlurmdPidFile={place}/slurmd.pid\n\
         ProctrackType=proctrack/linuxproc\n\
         TaskPlugin=task/none\n\
         SelectType=select/cons_tres\n\
         SelectTypeParameters=CR_CPU\n\
         MpiDefault=none\n\
         ReturnToService=2\n\
         KillWait=1\n\
         SchedulerParameters=sched_interval=1,bf_interval=1\n\
         NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN\n\
         PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP\n"
    )
}

fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    name.trim().split('.').next().unwrap().to_string()
}

/// Where a program is; daemons are not on every user's path.
fn program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let more = ["/usr/sbin", "/usr/local/sbin"].map(PathBuf::from);
    std::env::split_paths(&path).chain(more).map(|p| p.join(name)).find(|path| path.is_file())
}

/// Lines of a part's screens.
fn lines(part: &Path) -> usize {
    let files = std::fs::read_dir(part.join("screens")).into_iter().flatten();
    let texts = files.map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap());
    texts.map(|text| text.lines().count()).sum()
}

/// A task that was killed and requeued goes on from its checkpoint; the parts joined are the run of one machine.
#[test]
fn a_killed_and_requeued_task_changes_nothing() {
    let needed = ["munged", "slurmctld", "slurmd", "sbatch"];
    if let Some(missing) = needed.iter().find(|name| program(name).is_none()) {
        assert!(std::env::var_os("SPLASH_BOARDS").is_none(), "{missing} is not there");
        println!("skipped: {missing} is not there (packages slurm-wlm and munge)");
        return;
    }
    let run = ["--n", "4,16", "--screens", "24", "--sensing", "geometric"];
    let cluster = Cluster::start();
    let out = cluster.at("sweep");
    let submit = Path::new(env!("CARGO_MANIFEST_DIR")).join("slurm/submit");
    let arguments = [&[out.to_str().unwrap(), "2"], &run[..]].concat();
    let output = cluster.command(submit, &arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let jobs = String::from_utf8(output.stdout).unwrap();
    let array = jobs.split_whitespace().next().unwrap();

    let (task, part) = (format!("{array}_1"), out.join("part-1"));
    cluster.wait("the first screens", |_| lines(&part) >= 4);
    let requeued = cluster.command("scontrol", &["requeue", &task]).output().unwrap();
    assert!(requeued.status.success(), "{}", String::from_utf8_lossy(&requeued.stderr));
    cluster.wait("the end of the task", |cluster| {
        cluster.says("squeue", &["-h", "-r", "-j", &task, "-o", "%t"]).as_deref() == Some("PD")
    });
    let before = lines(&part);
    assert!((4..96).contains(&before), "{before} of 96 outcomes at the kill");
    // Slurm gives a requeued task two minutes before it starts again. What starts in the second in which it was killed,
    // it takes for killed: three are enough.
    let id = format!("JobId={task}");
    let now = cluster.command("scontrol", &["update", &id, "StartTime=now+3"]).output().unwrap();
    assert!(now.status.success(), "{}", String::from_utf8_lossy(&now.stderr));
    // It is started twice, and runs in the second time only what is missing.
    let log = || std::fs::read_to_string(out.join("part-1.log")).unwrap_or_default();
    cluster.wait("the second start", |_| log().contains("part 1/2, start 1"));
    cluster.wait("the end of all", |cluster| {
        let waiting = cluster.says("squeue", &["-h"]);
        waiting.is_some_and(|jobs| jobs.is_empty()) && out.join("merged.log").exists()
    });
    assert!(log().contains("part 1/2, start 0"), "{}", log());
    assert_eq!(lines(&part), 96);
    let merged = std::fs::read_to_string(out.join("merged.log")).unwrap();
    let merged: Value =
        merged.lines().find_map(|line| serde_json::from_str(line).ok()).expect("JSON");
    assert_eq!((&merged["parts"], &merged["missing"]), (&2.into(), &0.into()));
    let whole = common::json(
        "strehl",
        cluster.place.path(),
        "2",
        &[&run[..], &["--out", "whole"]].concat(),
    );
    assert_eq!((&merged["points"], &merged["paired"]), (&whole["points"], &whole["paired"]));
    for file in ["strehl.csv", "paired.csv", "screens.csv", "strehl.fits", "strehl.svg"] {
        let read = |of: &str| std::fs::read(cluster.at(of).join(file)).unwrap();
        assert!(read("sweep/merged") == read("whole"), "{file}");
    }
}
