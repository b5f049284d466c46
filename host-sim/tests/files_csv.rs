//! CSV series: what is written is read back, and errors name the place.

use host_sim::files::csv::{CsvError, Series, SeriesWriter};

#[test]
fn series_come_back_exactly() {
    let directory = tempfile::TempDir::new().unwrap();
    let path = directory.path().join("strehl.csv");
    let columns = ["time_s", "strehl", "variance_rad2"];
    let rows = [[0.001, 0.1 + 0.2, 1e-300], [2.0, f64::NAN, -0.0], [3.0, f64::INFINITY, 1e300]];
    let mut writer = SeriesWriter::create(&path, &columns).unwrap();
    for row in &rows {
        writer.push(row).unwrap();
    }
    let error = writer.push(&[1.0]).unwrap_err();
    assert!(matches!(error, CsvError::Row { expected: 3, found: 1, .. }), "{error}");
    writer.finish().unwrap();

    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("time_s,strehl,variance_rad2\n0.001,0.30000000000000004,"), "{text}");
    let series = Series::read(&path).unwrap();
    assert_eq!(series.columns, columns);
    for (read, written) in series.rows.iter().zip(&rows) {
        let bits = |row: &[f64]| row.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(read), bits(written));
    }
    assert_eq!(series.column("time_s").unwrap(), [0.001, 2.0, 3.0]);
    assert_eq!(series.column("time"), None);
}

#[test]
fn an_empty_series_has_its_header() {
    let directory = tempfile::TempDir::new().unwrap();
    let path = directory.path().join("empty.csv");
    SeriesWriter::create(&path, &["time_s"]).unwrap().finish().unwrap();
    let series = Series::read(&path).unwrap();
    assert_eq!((series.columns.len(), series.rows.len()), (1, 0));
}

#[test]
fn errors_name_line_and_column() {
    let directory = tempfile::TempDir::new().unwrap();
    let path = directory.path().join("bad.csv");
    std::fs::write(&path, "time_s,strehl\n1,2\n3,x\n").unwrap();
    let error = Series::read(&path).unwrap_err().to_string();
    assert!(error.ends_with("bad.csv: line 3, column strehl: \"x\" is not a number"), "{error}");
    std::fs::write(&path, "time_s,strehl\n1,2\n3\n").unwrap();
    assert!(matches!(Series::read(&path), Err(CsvError::Csv { .. })));
    let missing = directory.path().join("missing.csv");
    assert!(Series::read(&missing).unwrap_err().to_string().contains("missing.csv"));
    assert!(SeriesWriter::create(directory.path(), &["x"]).is_err());
}
